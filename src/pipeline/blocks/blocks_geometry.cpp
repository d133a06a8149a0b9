#include "pipeline/blocks/blocks_geometry.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/grouped.h"
#include "core/math/eigen.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

double coordinate(Vec2<double> p, int axis) {
    return axis == 0 ? p.x : p.y;
}

/// A cell with its points, before further cuts.
struct Part {
    GroundCell cell;
    std::vector<int> points;
    double weight = 0;
};

/// Range from the 1 % to the 99 % quantile, so that outliers do not count.
double spread(const std::vector<Vec2<double>>& points, const std::vector<int>& of, int axis) {
    std::vector<double> values;
    for (const int i : of) values.push_back(coordinate(points[i], axis));
    std::ranges::sort(values);
    const std::size_t skip = values.size() / 100;
    return values[values.size() - 1 - skip] - values[skip];
}

/// Cuts `part` along `axis`; `part` keeps the lower half. Returns false where all points have the
/// same coordinate.
bool cut(const std::vector<Vec2<double>>& points,
         const std::vector<double>& weights,
         int axis,
         Part& part,
         Part& upper) {
    const auto at = [&](int i) { return coordinate(points[i], axis); };
    std::vector<int> order = part.points;
    std::ranges::stable_sort(order, [&](int a, int b) { return at(a) < at(b); });
    double below = 0;
    std::size_t median = 0;
    while (median + 1 < order.size() && below + weights[order[median]] <= 0.5 * part.weight)
        below += weights[order[median++]];
    // Points at the cut belong above it; at least one must lie below.
    while (median < order.size() && !(at(order[median]) > at(order.front()))) ++median;
    if (median == order.size()) return false;
    const double place = at(order[median]);
    Part lower;
    lower.cell = upper.cell = part.cell;
    lower.cell.high[axis] = upper.cell.low[axis] = place;
    for (const int i : part.points) {
        Part& half = at(i) < place ? lower : upper;
        half.points.push_back(i), half.weight += weights[i];
    }
    part = std::move(lower);
    return true;
}

}  // namespace

GroundFrame ground_frame(Vec3d up) {
    up = normalize(up);
    GroundFrame frame;
    constexpr double kNear = 0.939692621;  // cos 20 degrees
    for (int axis = 0; axis < 3; ++axis)
        if (std::abs(up[axis]) > kNear) {
            Mat3<double>& R = frame.ground_from_world;
            R = {};
            R[0][axis == 0 ? 1 : 0] = 1, R[1][axis == 2 ? 1 : 2] = 1, R[2][axis] = 1;
            return frame;
        }
    // First ground axis: the projection of the world axis that is least upright.
    int least = 0;
    for (int axis = 1; axis < 3; ++axis)
        if (std::abs(up[axis]) < std::abs(up[least])) least = axis;
    Vec3d first;
    first[least] = 1;
    first = normalize(first - dot(first, up) * up);
    const Vec3d second = cross(up, first);
    for (int c = 0; c < 3; ++c) {
        frame.ground_from_world[0][c] = first[c];
        frame.ground_from_world[1][c] = second[c];
        frame.ground_from_world[2][c] = up[c];
    }
    return frame;
}

Vec3d up_of(const std::vector<Vec3d>& centres) {
    const auto found = sym_eigen(second_moments(centres));
    if (centres.size() < 3 || !(found.values[1] > 1e-6 * found.values[0]))
        throw input_error("the ", centres.size(),
                          " cameras are in a line or at one place, so the up "
                          "direction is unknown; give it with --up x,y,z");
    return column(found.vectors, 2);
}

double GroundCell::distance(Vec2<double> p) const {
    const double x = std::max({low[0] - p.x, p.x - high[0], 0.0}),
                 y = std::max({low[1] - p.y, p.y - high[1], 0.0});
    return std::hypot(x, y);
}

double GroundCell::share(Vec2<double> p, Vec2<double> reach) const {
    if (!(reach.x > 0 && reach.y > 0)) return holds(p) ? 1 : 0;
    const auto inside = [](double distance, double by) {
        return std::clamp(0.5 + distance / (2 * by), 0.0, 1.0);
    };
    return inside(p.x - low[0], reach.x) * inside(high[0] - p.x, reach.x) *
           inside(p.y - low[1], reach.y) * inside(high[1] - p.y, reach.y);
}

std::vector<GroundCell> split_cells(const std::vector<Vec2<double>>& points,
                                    const std::vector<double>& weights,
                                    int count,
                                    double most_weight) {
    Part all;
    all.points.resize(points.size());
    std::iota(all.points.begin(), all.points.end(), 0);
    all.weight = std::accumulate(weights.begin(), weights.end(), 0.0);
    std::vector<Part> parts{all};
    for (;;) {
        const auto heaviest = std::ranges::max_element(
            parts, [](const Part& a, const Part& b) { return a.weight < b.weight; });
        const bool enough =
            count > 0 ? int(parts.size()) >= count : !(heaviest->weight > most_weight);
        if (enough) break;
        Part upper;
        const std::vector<int>& of = heaviest->points;
        const int longer = !of.empty() && spread(points, of, 1) > spread(points, of, 0) ? 1 : 0;
        if (of.size() < 2 || (!cut(points, weights, longer, *heaviest, upper) &&
                              !cut(points, weights, 1 - longer, *heaviest, upper)))
            throw input_error("cannot cut a cell of ", grouped(of.size()),
                              " splats: too few, or all at one place; give fewer than ",
                              parts.size() + 1, " blocks, or a larger --max-splats");
        parts.insert(heaviest + 1, std::move(upper));
    }
    std::vector<GroundCell> cells;
    for (const Part& part : parts) cells.push_back(part.cell);
    return cells;
}

int cell_of(const std::vector<GroundCell>& cells, Vec2<double> p) {
    for (std::size_t i = 0; i < cells.size(); ++i)
        if (cells[i].holds(p)) return int(i);
    return -1;
}

std::vector<int> choose_block_views(const std::vector<BlockView>& views,
                                    int points,
                                    double least_share,
                                    int wanted) {
    std::vector<int> seen(points), chosen_see(seen.size());
    for (const BlockView& view : views)
        for (const int p : view.sees) ++seen[p];
    std::vector<int> order(views.size());
    std::iota(order.begin(), order.end(), 0);
    const auto share = [&](int v) { return views[v].share; };
    std::ranges::stable_sort(order, [&](int a, int b) { return share(a) > share(b); });
    std::vector<int> chosen;
    for (const int v : order) {
        const std::vector<int>& sees = views[v].sees;
        const bool needed = std::ranges::any_of(
            sees, [&](int p) { return seen[p] >= wanted && chosen_see[p] < wanted; });
        if (!(share(v) >= least_share) && !needed) continue;
        chosen.push_back(v);
        for (const int p : sees) ++chosen_see[p];
    }
    std::ranges::sort(chosen);
    return chosen;
}

}  // namespace tvsgs
