#include "optim/growth/init_cloud.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/device/parallel.h"
#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"
#include "core/math/eigen.h"
#include "core/math/point_tree.h"

namespace tvsgs {
namespace {

struct Cell {
    std::uint64_t key;
    std::uint32_t point;
};

/// Cells of a grid with this edge, sorted; 21 bits per axis.
std::vector<Cell> sorted_cells(const std::vector<Vec3f>& points, float edge) {
    Vec3f low = points[0];
    for (const Vec3f p : points)
        low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
    std::vector<Cell> cells(points.size());
    parallel_for(Cpu{}, int(points.size()), [&](int i) {
        std::uint64_t key = 0;
        for (int axis = 0; axis < 3; ++axis) {
            const float cell = (points[i][axis] - low[axis]) / edge;
            key = key << 21 | std::uint64_t(std::min(cell, 2097151.0f));
        }
        cells[i] = {key, std::uint32_t(i)};
    });
    std::ranges::sort(cells, [](const Cell& a, const Cell& b) {
        return a.key != b.key ? a.key < b.key : a.point < b.point;
    });
    return cells;
}

std::size_t occupied(const std::vector<Vec3f>& points, float edge) {
    const std::vector<Cell> cells = sorted_cells(points, edge);
    std::size_t count = 0;
    for (std::size_t i = 0; i < cells.size(); ++i)
        count += i == 0 || cells[i].key != cells[i - 1].key;
    return count;
}

float extent(const std::vector<Vec3f>& points) {
    Vec3f low = points[0], high = points[0];
    for (const Vec3f p : points)
        for (int axis = 0; axis < 3; ++axis)
            low[axis] = std::min(low[axis], p[axis]), high[axis] = std::max(high[axis], p[axis]);
    return norm(high - low);
}

/// Normal of the plane through point i and the points nearest to it.
Vec3f plane_normal(const std::vector<Vec3f>& points, const PointTree<float>& tree, std::size_t i) {
    constexpr std::size_t kPoints = 13;
    std::size_t index[kPoints];
    float squared[kPoints];
    const std::size_t found =
        tree.nearest(points[i], std::min(kPoints, points.size()), index, squared);
    Vec3d near[kPoints];
    for (std::size_t j = 0; j < found; ++j) near[j] = vec_cast<double>(points[index[j]]);
    return vec_cast<float>(column(sym_eigen(second_moments({near, found})).vectors, 2));
}

}  // namespace

PointCloud select_points(const PointCloud& cloud, const std::vector<std::size_t>& indices) {
    PointCloud out;
    const auto take = [&](const auto& from, auto& to) {
        if (from.empty()) return;
        to.reserve(indices.size());
        for (const std::size_t i : indices) to.push_back(from[i]);
    };
    take(cloud.positions, out.positions);
    take(cloud.colors, out.colors);
    take(cloud.normals, out.normals);
    take(cloud.confidences, out.confidences);
    return out;
}

PointCloud thin_cloud(const PointCloud& cloud, float edge) {
    if (cloud.positions.empty()) return cloud;
    // A key holds at most two million cells along an axis.
    const std::vector<Cell> cells =
        sorted_cells(cloud.positions, std::max(edge, extent(cloud.positions) / 2e6f));
    PointCloud out;
    for (std::size_t begin = 0, end = 0; begin < cells.size(); begin = end) {
        while (end < cells.size() && cells[end].key == cells[begin].key) ++end;
        const double share = 1 / double(end - begin);
        const auto mean = [&](const std::vector<Vec3f>& from) {
            Vec3d sum;
            for (std::size_t i = begin; i < end; ++i) sum += vec_cast<double>(from[cells[i].point]);
            return vec_cast<float>(share * sum);
        };
        out.positions.push_back(mean(cloud.positions));
        if (!cloud.colors.empty()) out.colors.push_back(mean(cloud.colors));
        if (!cloud.normals.empty()) {
            const Vec3f n = mean(cloud.normals);
            // Normals on opposite sides of a thin sheet cancel: take one of them.
            out.normals.push_back(norm(n) > 1e-3f ? normalize(n)
                                                  : cloud.normals[cells[begin].point]);
        }
        if (!cloud.confidences.empty()) {
            float best = 0;
            for (std::size_t i = begin; i < end; ++i)
                best = std::max(best, cloud.confidences[cells[i].point]);
            out.confidences.push_back(best);
        }
    }
    return out;
}

PointCloud thin_to_count(const PointCloud& cloud, std::size_t count) {
    if (cloud.positions.size() <= count) return cloud;
    // On a surface the number of occupied cubes falls about as the square of the edge.
    const float size = extent(cloud.positions);
    double low = std::log(1e-6), high = 0;  // of edge / size: too many points, few enough
    double guess = std::log(0.5 / std::sqrt(double(count)));
    for (int step = 0; step < 20; ++step) {
        const std::size_t found = occupied(cloud.positions, size * float(std::exp(guess)));
        if (found > count)
            low = guess;
        else
            high = guess;
        if (found <= count && found * 10 >= count * 9) break;
        const double aim = 0.96 * double(count);
        guess += 0.5 * std::log(double(found) / aim);
        if (!(guess > low && guess < high)) guess = 0.5 * (low + high);
    }
    PointCloud out = thin_cloud(cloud, size * float(std::exp(high)));
    if (out.positions.size() <= count) return out;
    // Many points in one place: no edge separates them.
    std::vector<std::size_t> indices;
    for (std::size_t i = 0; i < count; ++i) indices.push_back(i * out.positions.size() / count);
    return select_points(out, indices);
}

PointCloud remove_outliers(const PointCloud& cloud) {
    // Enough neighbours that members of a small clump of outliers are far from most of them.
    constexpr int kNeighbours = 20;
    constexpr double kDeviations = 2;
    if (cloud.positions.size() <= kNeighbours) return cloud;
    const std::vector<float> squared =
        mean_squared_neighbour_distance(cloud.positions, kNeighbours);
    double sum = 0, squares = 0;
    for (const float s : squared) {
        sum += std::sqrt(double(s));
        squares += double(s);
    }
    const double n = double(squared.size()), mean = sum / n;
    const double limit = mean + kDeviations * std::sqrt(std::max(squares / n - mean * mean, 0.0));
    std::vector<std::size_t> kept;
    for (std::size_t i = 0; i < squared.size(); ++i)
        if (std::sqrt(double(squared[i])) <= limit) kept.push_back(i);
    return select_points(cloud, kept);
}

CloudVisibility cloud_visibility(const PointCloud& cloud, const std::vector<View>& views) {
    const std::size_t stride = 1 + cloud.positions.size() / 200000;  // gives a fraction to 0.1 %
    std::size_t looked_at = 0, none = 0, two = 0;
    for (std::size_t i = 0; i < cloud.positions.size(); i += stride) {
        int seen = 0;
        for (const View& view : views) {
            seen += is_in_view(view.camera, cloud.positions[i]);
            if (seen == 2) break;
        }
        ++looked_at;
        none += seen == 0;
        two += seen == 2;
    }
    if (looked_at == 0) return {};
    const double n = double(looked_at);
    return {double(none) / n, double(two) / n};
}

PointCloud prepare_cloud(PointCloud cloud,
                         const std::vector<View>& views,
                         const InitOptions& options,
                         const std::string& name) {
    const std::size_t given = cloud.positions.size();
    const CloudVisibility visible = cloud_visibility(cloud, views);
    const auto percent = [](double share) { return std::round(1000 * share) / 10; };
    if (visible.two_views < double(options.min_in_frame))
        throw Error(ExitCode::input, name, ": ", percent(visible.two_views), " % of its ",
                    grouped(given), " points are visible in two training views; expected at least ",
                    percent(double(options.min_in_frame)),
                    " %: is the cloud in the frame of the scene, with the same units and axes? "
                    "init.min_in_frame=0 skips this check");
    if (visible.no_view > 0.01)
        spdlog::warn(
            "{}: no training view sees {:.1f} % of its points; training cannot correct them", name,
            100 * visible.no_view);
    if (options.thin > 0) cloud = thin_cloud(cloud, options.thin);
    if (options.max_points > 0) cloud = thin_to_count(cloud, std::size_t(options.max_points));
    if (cloud.positions.size() != given)
        spdlog::info("{}: thinned to {} of {} points", name, grouped(cloud.positions.size()),
                     grouped(given));
    return cloud;
}

FixedVoters make_fixed_voters(const PointCloud& cloud, const TvOptions& options) {
    const std::string& path = options.fixed_voters;
    FixedVoters voters;
    for (std::size_t i = 0; i < cloud.positions.size(); ++i) {
        if (!is_finite(cloud.positions[i])) continue;
        const float weight = cloud.confidences.empty() ? 1.0f : cloud.confidences[i];
        if (!(weight >= 0 && weight < 1e30f))
            throw Error(ExitCode::input, path, ": weight ", weight, " of point ", i,
                        "; expected a number of at least 0");
        voters.means.push_back(cloud.positions[i]);
        voters.normals.push_back(cloud.normals.empty() ? Vec3f{} : cloud.normals[i]);
        voters.weights.push_back(options.fixed_weight * weight);
    }
    if (voters.size() < 3)
        throw Error(ExitCode::input, path, ": ", voters.size(),
                    " usable points; measured points that vote need at least 3");
    for (const float squared : mean_squared_neighbour_distance(voters.means, 3))
        voters.scales.push_back(std::sqrt(squared));
    const PointTree<float> tree(voters.means);
    parallel_for(Cpu{}, voters.size(), [&](int i) {
        if (!(dot(voters.normals[i], voters.normals[i]) > 0.5f))
            voters.normals[i] = plane_normal(voters.means, tree, i);
    });
    return voters;
}

}  // namespace tvsgs
