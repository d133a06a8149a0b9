#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>

#include "core/device/parallel.h"
#include "core/error.h"
#include "core/math/point_tree.h"
#include "core/math/rng.h"
#include "eval/mesh_metrics.h"
#include "eval/points.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

/// Sums of K numbers over all indices, in a fixed order; term(i, sums) adds index i.
template <std::size_t K, class Term>
std::array<double, K> sums_of(std::size_t count, const Term& term) {
    std::array<std::array<double, K>, kSumBlocks> partial{};
    const std::size_t chunk = (count + kSumBlocks - 1) / kSumBlocks;
    const auto sum_block = [&](int block) {
        const std::size_t first = static_cast<std::size_t>(block) * chunk;
        for (std::size_t i = first; i < std::min(count, first + chunk); ++i)
            term(i, partial[block]);
    };
    if (count > 4096)
        parallel_for_heavy(Cpu{}, kSumBlocks, sum_block);
    else
        for (int block = 0; block < kSumBlocks; ++block) sum_block(block);
    std::array<double, K> total{};
    for (const auto& sums : partial)
        for (std::size_t k = 0; k < K; ++k) total[k] += sums[k];
    return total;
}

/// Fits a similarity; pair(i) returns a point and its partner.
template <class Pair>
std::optional<Affine3d> fit(std::size_t count, const Pair& pair) {
    if (count < 3) return std::nullopt;
    const double n = static_cast<double>(count);
    const auto sum = sums_of<6>(count, [&](std::size_t i, auto& s) {
        const auto [a, b] = pair(i);
        for (int k = 0; k < 3; ++k) s[k] += a[k], s[k + 3] += b[k];
    });
    const Vec3d mean_a{sum[0] / n, sum[1] / n, sum[2] / n},
        mean_b{sum[3] / n, sum[4] / n, sum[5] / n};
    const auto moments = sums_of<10>(count, [&](std::size_t i, auto& s) {
        const auto [a, b] = pair(i);
        const Vec3d da = a - mean_a, db = b - mean_b;
        for (int r = 0; r < 3; ++r)
            for (int c = 0; c < 3; ++c) s[3 * r + c] += db[r] * da[c];
        s[9] += dot(da, da);
    });
    if (!(moments[9] > 0 && std::isfinite(moments[9]))) return std::nullopt;
    Eigen::Matrix3d covariance;
    for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c) covariance(r, c) = moments[3 * r + c];
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance,
                                                Eigen::ComputeFullU | Eigen::ComputeFullV);
    const Eigen::Vector3d spread = svd.singularValues();
    // Collinear points do not determine the rotation around their line.
    if (!(spread(1) > 1e-12 * spread(0) && spread(0) > 0)) return std::nullopt;
    Eigen::Vector3d sign(1, 1, 1);
    if (svd.matrixU().determinant() * svd.matrixV().determinant() < 0) sign(2) = -1;
    const Eigen::Matrix3d R = svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose();
    const double scale = spread.dot(sign) / moments[9];
    if (!(scale > 0)) return std::nullopt;
    Affine3d T;
    for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c) T.A[r][c] = scale * R(r, c);
    T.t = mean_b - T.A * mean_a;
    return T;
}

/// Number of inliers of T, and their squared error.
std::pair<int, double> count_inliers(const Points& from,
                                     const Points& to,
                                     const Affine3d& T,
                                     double threshold) {
    int inliers = 0;
    double squared = 0;
    for (std::size_t i = 0; i < from.size(); ++i) {
        const Vec3d d = T * from[i] - to[i];
        if (!(dot(d, d) < threshold * threshold)) continue;
        ++inliers, squared += dot(d, d);
    }
    return {inliers, squared};
}

/// The best similarity from many draws of six random pairs.
Affine3d draw_alignment(const Points& from,
                        const Points& to,
                        double threshold,
                        std::uint64_t seed) {
    constexpr int kDraws = 100000;
    constexpr std::size_t kPairs = 6;
    std::optional<Affine3d> best;
    std::pair<int, double> best_score{-1, 0};
    for (int draw = 0; draw < kDraws; ++draw) {
        std::size_t chosen[kPairs];
        for (std::size_t k = 0; k < kPairs; ++k) {
            const Random4 r = random4(seed, RandomStream::ransac, static_cast<std::uint64_t>(draw),
                                      static_cast<std::uint32_t>(k / 4));
            chosen[k] = static_cast<std::size_t>(std::uint64_t{r.v[k % 4]} * from.size() >> 32);
        }
        const auto T = fit(kPairs, [&](std::size_t i) {
            return std::pair{from[chosen[i]], to[chosen[i]]};
        });
        if (!T) continue;
        const auto score = count_inliers(from, to, *T, threshold);
        const bool better = score.first > best_score.first ||
                            (score.first == best_score.first && score.second < best_score.second);
        if (better) best = T, best_score = score;
    }
    if (!best)
        throw input_error("E_TNT_TRAJ: the ", from.size(),
                          " pairs of camera centres are at one place or on one "
                          "line; expected cameras around the scene");
    return *best;
}

}  // namespace

std::optional<Affine3d> fit_similarity(const Points& from, const Points& to) {
    return fit(from.size(), [&](std::size_t i) { return std::pair{from[i], to[i]}; });
}

CentreAlignment align_centres(const Points& from,
                              const Points& to,
                              double threshold,
                              std::uint64_t seed) {
    const auto score = [&](const Affine3d& T) { return count_inliers(from, to, T, threshold); };
    CentreAlignment out;
    const auto to_all = fit_similarity(from, to);
    if (to_all && score(*to_all).first == static_cast<int>(from.size())) {
        out.to_from_from = *to_all, out.refined = true;
    } else {
        out.to_from_from = draw_alignment(from, to, threshold, seed);
        Points a, b;
        for (std::size_t i = 0; i < from.size(); ++i)
            if (norm(out.to_from_from * from[i] - to[i]) < threshold)
                a.push_back(from[i]), b.push_back(to[i]);
        // Six inliers are a result of chance. The refit is kept when it loses no inlier.
        if (const auto T = fit_similarity(a, b);
            a.size() > 6 && T && score(*T).first >= static_cast<int>(a.size()))
            out.to_from_from = *T, out.refined = true;
    }
    const auto [inliers, squared] = score(out.to_from_from);
    out.inliers = inliers;
    out.rmse = inliers > 0 ? std::sqrt(squared / inliers) : 0;
    std::vector<double> residuals;
    for (std::size_t i = 0; i < from.size(); ++i)
        residuals.push_back(norm(out.to_from_from * from[i] - to[i]));
    out.median_residual = median_of(std::move(residuals));
    return out;
}

IcpResult icp(const Points& source, const Points& target, const IcpOptions& options) {
    IcpResult result;
    result.source = static_cast<std::int64_t>(source.size());
    result.target = static_cast<std::int64_t>(target.size());
    if (source.empty() || target.empty()) return result;
    const PointTree<double, double> tree(target);
    Points moved = source;
    std::vector<std::uint32_t> with, partner(source.size());  // pairs: moved[with], partner
    std::vector<double> squared(source.size());
    const auto match = [&] {
        const double limit = options.max_distance * options.max_distance;
        parallel_for(Cpu{}, static_cast<int>(moved.size()), [&](int i) {
            std::size_t index = 0;
            if (!tree.nearest_within(moved[i], limit, &index, &squared[i])) squared[i] = -1;
            partner[i] = static_cast<std::uint32_t>(index);
        });
        with.clear();
        for (std::size_t i = 0; i < moved.size(); ++i)
            if (squared[i] >= 0) with.push_back(static_cast<std::uint32_t>(i));
        const double error =
            sums_of<1>(with.size(), [&](std::size_t i, auto& s) { s[0] += squared[with[i]]; })[0];
        const double pairs = static_cast<double>(with.size());
        result.fitness = pairs / static_cast<double>(moved.size());
        result.rmse = with.empty() ? 0 : std::sqrt(error / pairs);
    };
    match();
    while (result.iterations < options.max_iterations) {
        const auto step = fit(with.size(), [&](std::size_t i) {
            return std::pair{moved[with[i]], target[partner[with[i]]]};
        });
        if (!step) break;
        result.target_from_source = *step * result.target_from_source;
        moved = transformed(moved, *step);
        const double fitness = result.fitness, rmse = result.rmse;
        match();
        ++result.iterations;
        if (std::abs(fitness - result.fitness) < options.fitness_change &&
            std::abs(rmse - result.rmse) < options.rmse_change)
            break;
    }
    return result;
}

Points transformed(const Points& points, const Affine3d& T) {
    Points out(points.size());
    parallel_for(Cpu{}, static_cast<int>(points.size()), [&](int i) { out[i] = T * points[i]; });
    return out;
}

Points cropped(const Points& points, const Crop& crop) {
    std::vector<char> inside(points.size());
    parallel_for(Cpu{}, static_cast<int>(points.size()),
                 [&](int i) { inside[i] = contains(crop, points[i]); });
    Points out;
    for (std::size_t i = 0; i < points.size(); ++i)
        if (inside[i]) out.push_back(points[i]);
    return out;
}

MotionDifference difference(const Affine3d& S, const Affine3d& T, Vec3d point) {
    MotionDifference out;
    const double s = scale_of(S), t = scale_of(T);
    out.scale = s / t;
    // Trace of S's rotation times the inverse of T's rotation.
    double trace = 0;
    for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c) trace += S.A[r][c] * T.A[r][c] / (s * t);
    out.angle_rad = std::acos(std::clamp(0.5 * (trace - 1), -1.0, 1.0));
    // Apply the inverse of T, then S.
    const Vec3d back = transpose_times(T.A, point - T.t) / (t * t);
    out.shift = norm(S * back - point);
    return out;
}

}  // namespace tvsgs
