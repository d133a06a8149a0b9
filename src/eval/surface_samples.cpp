#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "core/device/parallel.h"
#include "core/math/rng.h"
#include "eval/mesh_metrics.h"

namespace tvsgs {
namespace {

constexpr std::size_t kMaxCells = 4096;
constexpr int kMaxDepth = 20;
constexpr std::int64_t kMaxLines = 100'000'000;
constexpr std::int64_t kMaxMisses = 4'000'000;  // gives up after so many lines without a hit
constexpr std::int64_t kRound = 1 << 16;        // lines between two checks of the error

/// A cell of a grid that divides a box into 2^depth cells per side.
struct Cell {
    std::array<std::uint32_t, 3> at;
};

struct Grid {
    Vec3d lower, size;  // of the whole grid
    int depth = 0;
    std::vector<Cell> cells;  // cells that contain surface

    double edge(int axis) const { return size[axis] / std::exp2(depth); }
    Vec3d lower_of(const Cell& cell) const {
        Vec3d p;
        for (int axis = 0; axis < 3; ++axis) p[axis] = lower[axis] + cell.at[axis] * edge(axis);
        return p;
    }
    Vec3d upper_of(const Cell& cell) const {
        Vec3d p = lower_of(cell);
        for (int axis = 0; axis < 3; ++axis) p[axis] += edge(axis);
        return p;
    }
    /// Whether the cell contains the point; a point between two cells belongs to one of them.
    bool holds(const Cell& cell, Vec3d p) const {
        const double last = std::exp2(depth) - 1;
        for (int axis = 0; axis < 3; ++axis) {
            const double place = std::floor((p[axis] - lower[axis]) / edge(axis));
            if (std::clamp(place, 0.0, last) != cell.at[axis]) return false;
        }
        return true;
    }
    double face(int axis) const { return edge((axis + 1) % 3) * edge((axis + 2) % 3); }
    double cell_area() const { return 2 * (face(0) + face(1) + face(2)); }
    double area() const { return static_cast<double>(cells.size()) * cell_area(); }
};

PointBounds bounds_of(const Crop& crop) {
    constexpr double kFar = std::numeric_limits<double>::infinity();
    switch (crop.kind) {
        case Crop::Kind::everything:
            break;
        case Crop::Kind::box:
            return {crop.min, crop.max};
        case Crop::Kind::cylinder:
            return {{crop.center_x - crop.radius, crop.center_y - crop.radius, crop.min.z},
                    {crop.center_x + crop.radius, crop.center_y + crop.radius, crop.max.z}};
        case Crop::Kind::prism: {
            PointBounds box = bounds_of(crop.polygon);
            box.lower[crop.axis] = crop.axis_min, box.upper[crop.axis] = crop.axis_max;
            return box;
        }
    }
    return {{-kFar, -kFar, -kFar}, {kFar, kFar, kFar}};
}

/// Bounding box of the surface in the crop, in the mesh's frame.
PointBounds common_box(const TriangleTree& tree, const Crop& crop, Vec3d origin) {
    const PointBounds cropped = bounds_of(crop);
    PointBounds box{tree.lower(), tree.upper()};
    for (int axis = 0; axis < 3; ++axis) {
        box.lower[axis] = std::max(box.lower[axis], cropped.lower[axis] - origin[axis]);
        box.upper[axis] = std::min(box.upper[axis], cropped.upper[axis] - origin[axis]);
    }
    return box;
}

/// Chooses the grid for which the fewest lines miss the surface. Without a grid, a distant fragment
/// would make nearly all lines miss.
Grid choose_grid(const TriangleTree& tree, PointBounds box) {
    Vec3d size = box.upper - box.lower;
    const double longest = std::max({size.x, size.y, size.z});
    // Enlarge the box by odd shares: points on a side of a cell would belong to a cell by rounding,
    // and no line meets a box without height.
    constexpr double kBefore = 0.00317, kAfter = 0.00411;
    for (int axis = 0; axis < 3; ++axis) {
        box.lower[axis] -= kBefore * longest;
        size[axis] += (kBefore + kAfter) * longest;
    }
    Grid grid{box.lower, size, 0, {{{0, 0, 0}}}};
    Grid best = grid;
    while (grid.depth < kMaxDepth && grid.cells.size() <= kMaxCells) {
        Grid finer{grid.lower, grid.size, grid.depth + 1, {}};
        for (const Cell& cell : grid.cells)
            for (std::uint32_t child = 0; child < 8; ++child) {
                Cell part;
                for (std::size_t axis = 0; axis < 3; ++axis)
                    part.at[axis] = 2 * cell.at[axis] + (child >> axis & 1);
                if (tree.meets(finer.lower_of(part), finer.upper_of(part)))
                    finer.cells.push_back(part);
            }
        grid = std::move(finer);
        if (grid.area() < best.area()) best = grid;
    }
    return best;
}

double fraction(std::uint32_t bits) {
    return (static_cast<double>(bits) + 0.5) / 4294967296.0;
}

/// Draws a line uniformly among the lines that meet the cell: uniform over its sides, and in the
/// cosine of the angle to them.
Line line_through(const Grid& grid, const Cell& cell, std::uint64_t seed, std::uint64_t index) {
    const std::uint64_t key = (std::uint64_t(cell.at[0]) << 42) ^
                              (std::uint64_t(cell.at[1]) << 21) ^ std::uint64_t(cell.at[2]);
    // One random stream per cell, from the seed and the cell's place.
    const std::uint64_t of_cell = seed ^ key * 0x9E3779B97F4A7C15ull;
    const Random4 first = random4(of_cell, RandomStream::lines, index, 0),
                  second = random4(of_cell, RandomStream::lines, index, 1);
    double place = fraction(first.v[0]) * 0.5 * grid.cell_area();
    int axis = 0;
    while (axis < 2 && place >= grid.face(axis)) place -= grid.face(axis), ++axis;
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    const bool upper = (first.v[3] & 1) != 0;
    Vec3d point = grid.lower_of(cell), direction;
    if (upper) point[axis] += grid.edge(axis);
    point[u] += fraction(first.v[1]) * grid.edge(u);
    point[v] += fraction(first.v[2]) * grid.edge(v);
    const double sine = std::sqrt(fraction(second.v[0])),
                 angle = 2 * 3.141592653589793 * fraction(second.v[1]);
    direction[u] = sine * std::cos(angle), direction[v] = sine * std::sin(angle);
    direction[axis] = (upper ? -1 : 1) * std::sqrt(1 - sine * sine);
    return {point, direction};
}

/// The number of draws of each size, in points.
using DrawSizes = std::map<std::size_t, std::size_t>;

/// Draws of m of n points each add (k - share * m)^2 / n^2 to the variance of a share, if k of the
/// m count. For a share up to 1/2 the sum is largest if all points of the largest draws count; a
/// share above 1/2 has the error of the rest.
double worst_standard_error(const DrawSizes& sizes) {
    double points = 0, squares = 0;
    for (const auto& [size, draws] : sizes) {
        const double m = static_cast<double>(size), n = static_cast<double>(draws) * m;
        points += n, squares += n * m;
    }
    double share = 0, counted = 0, worst = 0;  // `counted`: squares of the draws that count
    for (auto next = sizes.rbegin(); next != sizes.rend() && share < 0.5; ++next) {
        const double m = static_cast<double>(next->first), per_share = m * points,
                     end = std::min(0.5, share + static_cast<double>(next->second) * m / points);
        const auto variance = [&](double at) {
            return (counted + per_share * (at - share)) * (1 - 2 * at) + at * at * squares;
        };
        worst = std::max(worst, variance(end));
        // Where the derivative vanishes.
        const double peak =
            (per_share * (1 + 2 * share) - 2 * counted) / (4 * per_share - 2 * squares);
        if (peak > share && peak < end) worst = std::max(worst, variance(peak));
        counted += per_share * (end - share), share = end;
    }
    return points > 0 ? std::sqrt(worst) / points : 0;
}

}  // namespace

double worst_standard_error(const SamplePoints& sample) {
    DrawSizes sizes;
    for (std::size_t d = 0; d < sample.draws.size(); ++d) {
        const std::size_t end =
            d + 1 < sample.draws.size() ? sample.draws[d + 1] : sample.points.size();
        ++sizes[end - sample.draws[d]];
    }
    return worst_standard_error(sizes);
}

SamplePoints sample_by_lines(const TriangleTree& tree,
                             const Crop& crop,
                             Vec3d origin,
                             double standard_error,
                             std::uint64_t seed) {
    SamplePoints sample;
    if (tree.empty()) return sample;
    const PointBounds box = common_box(tree, crop, origin);
    for (int axis = 0; axis < 3; ++axis)
        if (!(box.lower[axis] <= box.upper[axis])) return sample;
    if (!tree.meets(box.lower, box.upper)) return sample;
    const Grid grid = choose_grid(tree, box);
    if (!(grid.cell_area() > 0)) return sample;  // the whole surface is a single point

    const auto cells = static_cast<std::int64_t>(grid.cells.size());
    const std::int64_t per_cell = (kRound + cells - 1) / cells;
    constexpr std::int64_t kChunk = 256;  // lines per thread
    std::int64_t lines = 0;
    DrawSizes sizes;
    for (std::int64_t round = 0; lines < kMaxLines; ++round) {
        const std::int64_t count = cells * per_cell;
        std::vector<Points> cuts((count + kChunk - 1) / kChunk);
        std::vector<std::vector<std::uint32_t>> begins(cuts.size());
        parallel_for_heavy(Cpu{}, static_cast<int>(cuts.size()), [&](int chunk) {
            auto& points = cuts[chunk];
            for (std::int64_t i = chunk * kChunk; i < std::min(count, (chunk + 1) * kChunk); ++i) {
                const Cell& cell = grid.cells[i / per_cell];
                const Line line = line_through(
                    grid, cell, seed, static_cast<std::uint64_t>(round * per_cell + i % per_cell));
                const std::size_t before = points.size();
                tree.for_each_cut(line, grid.lower_of(cell), grid.upper_of(cell), [&](Vec3d p) {
                    if (grid.holds(cell, p) && contains(crop, p + origin)) points.push_back(p);
                });
                if (points.size() > before)
                    begins[chunk].push_back(static_cast<std::uint32_t>(before));
            }
        });
        lines += count;
        for (std::size_t chunk = 0; chunk < cuts.size(); ++chunk) {
            const std::size_t before = sample.points.size();
            begins[chunk].push_back(static_cast<std::uint32_t>(cuts[chunk].size()));
            for (std::size_t d = 0; d + 1 < begins[chunk].size(); ++d) {
                sample.draws.push_back(static_cast<std::uint32_t>(before + begins[chunk][d]));
                ++sizes[begins[chunk][d + 1] - begins[chunk][d]];
            }
            sample.points.insert(sample.points.end(), cuts[chunk].begin(), cuts[chunk].end());
        }
        if (sizes.empty() && lines >= kMaxMisses) break;
        if (!sizes.empty() && worst_standard_error(sizes) <= standard_error) break;
    }
    // A line that meets a convex body of area A intersects a surface of area S inside it 2 S / A
    // times on average.
    sample.area =
        static_cast<double>(sample.points.size()) / static_cast<double>(lines) * 0.5 * grid.area();
    return sample;
}

}  // namespace tvsgs
