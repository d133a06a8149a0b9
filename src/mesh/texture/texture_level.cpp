#include <Eigen/Sparse>
#include <algorithm>
#include <cmath>
#include <optional>

#include "core/device/parallel.h"
#include "mesh/texture/texture_steps.h"

namespace tvsgs::texture {
namespace {

constexpr double kSpacing_px = 8;
constexpr int kMaxValues = 200000;   // of all charts; the spacing doubles above it
constexpr double kSmoothness = 0.1;  // weight of differences between neighbours, relative to steps
// Weight of the difference of a pixel from the mean of all views.
constexpr double kAgreement = 0.1;
constexpr double kDamping = 1e-4;    // of values without faces
constexpr double kPlaceStep_px = 2;  // along an edge

/// Interpolation in a correction: four values and their weights.
struct Weights {
    int index[4];
    double weight[4];
};

Weights weights_at(const Correction& grid, double u, double v) {
    const double x = std::clamp((u - grid.left) / grid.spacing, 0.0, grid.columns - 1.001);
    const double y = std::clamp((v - grid.top) / grid.spacing, 0.0, grid.rows - 1.001);
    const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
    const double fx = x - x0, fy = y - y0;
    const int at = y0 * grid.columns + x0;
    return {{at, at + 1, at + grid.columns, at + grid.columns + 1},
            {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy}};
}

Correction grid_of(const Chart& chart, double spacing) {
    Correction grid;
    grid.left = chart.bounds[0], grid.top = chart.bounds[1], grid.spacing = spacing;
    const auto count = [&](int axis) {
        return static_cast<int>((chart.bounds[2 + axis] - chart.bounds[axis]) / spacing) + 2;
    };
    grid.columns = count(0), grid.rows = count(1);
    grid.values.resize(static_cast<std::size_t>(grid.columns) * grid.rows);
    return grid;
}

/// Marks the values around the faces of a chart, because most of its rectangle can be empty.
void mark_used(const Subject& in,
               const Chart& chart,
               const Correction& grid,
               std::vector<int>& used) {
    const TriangleMesh& mesh = in.mesh;
    const PhotoView& view = in.views[chart.view];
    for (const int f : chart.faces) {
        double low[2] = {1e30, 1e30}, high[2] = {-1e30, -1e30};
        for (int c = 0; c < 3; ++c) {
            const Projection p = view.project(vec_cast<double>(mesh.vertices[mesh.faces[f][c]]));
            low[0] = std::min(low[0], p.u), high[0] = std::max(high[0], p.u);
            low[1] = std::min(low[1], p.v), high[1] = std::max(high[1], p.v);
        }
        const auto column = [&](double u) {
            return std::clamp(static_cast<int>((u - grid.left) / grid.spacing), 0,
                              grid.columns - 2);
        };
        const auto row = [&](double v) {
            return std::clamp(static_cast<int>((v - grid.top) / grid.spacing), 0, grid.rows - 2);
        };
        for (int y = row(low[1]); y <= row(high[1]) + 1; ++y)
            for (int x = column(low[0]); x <= column(high[0]) + 1; ++x)
                used[static_cast<std::size_t>(y) * grid.columns + x] = 1;
    }
}

struct Unknowns {
    std::vector<Correction> grids;
    // Index of each grid's values among the unknowns, -1: not used.
    std::vector<std::vector<int>> numbers;
    int count = 0;

    Unknowns(const Subject& in, const std::vector<Chart>& charts, double spacing) {
        for (const Chart& chart : charts) {
            grids.push_back(grid_of(chart, spacing));
            std::vector<int> used(grids.back().values.size(), 0);
            mark_used(in, chart, grids.back(), used);
            for (int& number : used) number = number ? count++ : -1;
            numbers.push_back(std::move(used));
        }
    }
};

/// Difference of the mean colour of a face over all views, weighted by quality, from its own view;
/// `pixels`: area in the own view.
struct Difference {
    Vec3d color;
    double pixels = 0;

    Difference(const Candidates& candidates, const FaceShape& shape, int face, int view) {
        Vec3d sum;
        double weights = 0;
        Vec3f own;
        for (const Candidate& c : candidates.of(face)) {
            const double weight = std::max(double{c.quality}, 1e-30);
            sum += weight * vec_cast<double>(c.color), weights += weight;
            if (c.view == view) own = c.color, pixels = shape.area / (double{c.pixel} * c.pixel);
        }
        if (pixels > 0) color = sum / weights - vec_cast<double>(own);
    }
};

/// Target of one chart at each of its values.
struct ChartTarget {
    std::vector<double> weights;
    std::vector<Vec3d> sums;

    ChartTarget(const Subject& in, const Chart& chart, const Correction& grid)
        : weights(grid.values.size(), 0), sums(grid.values.size()) {
        for (const int f : chart.faces) {
            const FaceShape shape(in.mesh, f);
            const Difference difference(in.candidates, shape, f, chart.view);
            const Projection at = in.views[chart.view].project(shape.centre);
            const Weights w = weights_at(grid, at.u, at.v);
            for (int j = 0; j < 4; ++j) {
                const double weight = kAgreement * difference.pixels * w.weight[j];
                weights[w.index[j]] += weight, sums[w.index[j]] += weight * difference.color;
            }
        }
    }
};

/// A point on an edge between two charts, and the step in colour there.
struct SeamPlace {
    int index[8];  // of unknowns
    double weight[8];
    Vec3f step;
};

/// Points along all edges between charts.
std::vector<SeamPlace> seam_places(const Subject& in,
                                   const std::vector<Chart>& charts,
                                   const Unknowns& unknowns) {
    const auto& [mesh, views, candidates, edges] = in;
    std::vector<int> chart_of(mesh.faces.size(), -1);
    for (std::size_t k = 0; k < charts.size(); ++k)
        for (const int f : charts[k].faces) chart_of[f] = static_cast<int>(k);
    struct Seam {
        int sides[2], count;  // charts; number of points
        Vec3d from, to;
        std::size_t first;
    };
    std::vector<Seam> seams;
    std::size_t total = 0;
    for (const SharedEdge& edge : edges) {
        const int one = chart_of[edge.faces[0]], other = chart_of[edge.faces[1]];
        if (one < 0 || other < 0 || one == other) continue;
        const Vec3d from = vec_cast<double>(mesh.vertices[edge.vertices[0]]),
                    to = vec_cast<double>(mesh.vertices[edge.vertices[1]]);
        const PhotoView& view = views[charts[one].view];
        const Projection p = view.project(from), q = view.project(to);
        const int n = static_cast<int>(
            std::clamp(std::ceil(std::hypot(p.u - q.u, p.v - q.v) / kPlaceStep_px), 1.0, 1000.0));
        seams.push_back({{one, other}, n, from, to, total});
        total += static_cast<std::size_t>(n);
    }
    std::vector<SeamPlace> out(total);
    parallel_for(Cpu{}, static_cast<int>(seams.size()), [&](int e) {
        const Seam& seam = seams[e];
        for (int i = 0; i < seam.count; ++i) {
            const Vec3d point = seam.from + (i + 0.5) / seam.count * (seam.to - seam.from);
            SeamPlace& place = out[seam.first + static_cast<std::size_t>(i)];
            for (int s = 0; s < 2; ++s) {
                const int k = seam.sides[s];
                const PhotoView& view = views[charts[k].view];
                const Projection at = view.project(point);
                const Weights w = weights_at(unknowns.grids[k], at.u, at.v);
                for (int j = 0; j < 4; ++j) {
                    place.index[4 * s + j] = unknowns.numbers[k][w.index[j]];
                    place.weight[4 * s + j] = s == 0 ? w.weight[j] : -w.weight[j];
                }
                const Vec3f color = view.color(at.u, at.v, 3);
                place.step += s == 0 ? color : -color;
            }
        }
    });
    return out;
}

}  // namespace

Vec3f Correction::at(double u, double v) const {
    const Weights w = weights_at(*this, u, v);
    Vec3f sum;
    for (int i = 0; i < 4; ++i) sum += static_cast<float>(w.weight[i]) * values[w.index[i]];
    return sum;
}

std::vector<Correction> level_seams(const Subject& in,
                                    const std::vector<Chart>& charts,
                                    int& compared) {
    compared = 0;
    if (charts.empty()) return {};
    double spacing = kSpacing_px;
    Unknowns unknowns(in, charts, spacing);
    while (unknowns.count > kMaxValues && spacing < 1e4)
        unknowns = Unknowns(in, charts, spacing *= 2);

    std::vector<Eigen::Triplet<double>> entries;
    Eigen::MatrixXd b = Eigen::MatrixXd::Zero(unknowns.count, 3);
    // 1. Brightness near the mean of all views, and similar neighbouring values.
    std::vector<std::optional<ChartTarget>> targets(charts.size());
    parallel_for_heavy(Cpu{}, static_cast<int>(charts.size()),
                       [&](int k) { targets[k].emplace(in, charts[k], unknowns.grids[k]); });
    for (std::size_t k = 0; k < charts.size(); ++k) {
        const Correction& grid = unknowns.grids[k];
        const std::vector<int>& number = unknowns.numbers[k];
        for (int y = 0; y < grid.rows; ++y)
            for (int x = 0; x < grid.columns; ++x) {
                const int i = y * grid.columns + x, a = number[i];
                if (a < 0) continue;
                entries.emplace_back(a, a, kDamping + targets[k]->weights[i]);
                for (int c = 0; c < 3; ++c) b(a, c) += targets[k]->sums[i][c];
                for (const int j : {x + 1 < grid.columns ? i + 1 : -1,
                                    y + 1 < grid.rows ? i + grid.columns : -1}) {
                    if (j < 0 || number[j] < 0) continue;
                    entries.emplace_back(a, a, kSmoothness);
                    entries.emplace_back(number[j], number[j], kSmoothness);
                    entries.emplace_back(std::max(a, number[j]), std::min(a, number[j]),
                                         -kSmoothness);
                }
            }
    }
    // 2. Equal colour on both sides of an edge.
    const std::vector<SeamPlace> places = seam_places(in, charts, unknowns);
    for (const SeamPlace& place : places)
        for (int j = 0; j < 8; ++j) {
            if (place.weight[j] == 0) continue;
            for (int c = 0; c < 3; ++c)
                b(place.index[j], c) -= place.weight[j] * double{place.step[c]};
            for (int l = 0; l < 8; ++l)
                if (place.index[l] <= place.index[j] && place.weight[l] != 0)
                    entries.emplace_back(place.index[j], place.index[l],
                                         place.weight[j] * place.weight[l]);
        }
    compared = static_cast<int>(places.size());
    Eigen::SparseMatrix<double> A(unknowns.count, unknowns.count);
    A.setFromTriplets(entries.begin(), entries.end());
    const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>, Eigen::Lower> solver(A);
    const Eigen::MatrixXd g = solver.solve(b);
    for (std::size_t k = 0; k < charts.size(); ++k)
        for (std::size_t i = 0; i < unknowns.numbers[k].size(); ++i)
            if (const int number = unknowns.numbers[k][i]; number >= 0)
                for (int c = 0; c < 3; ++c)
                    unknowns.grids[k].values[i][c] = static_cast<float>(g(number, c));
    return std::move(unknowns.grids);
}

}  // namespace tvsgs::texture
