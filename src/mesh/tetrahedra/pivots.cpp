#include <algorithm>
#include <bit>
#include <cmath>

#include "core/device/morton.h"
#include "core/math/quantile.h"
#include "mesh/tetrahedra/delaunay.h"
#include "mesh/tetrahedra/tetrahedra_steps.h"

namespace tvsgs {
namespace {

constexpr float kReach = 3;       // standard deviations
constexpr float kSlack = 1.001f;  // factor of radii, for the displacement by the grid
constexpr double kBoxFactor = 4;  // size of the box relative to the splats' extent

/// A set of at most `most` numbers, with few bytes each.
class SmallSet {
public:
    explicit SmallSet(std::size_t most) : slots_(std::bit_ceil(2 * most + 2), 0) {}

    /// False if the set contains it already.
    bool insert(std::uint64_t key) {
        key += key == 0;
        const std::size_t mask = slots_.size() - 1;
        std::size_t at = static_cast<std::size_t>(key) & mask;
        for (; slots_[at] != 0; at = (at + 1) & mask)
            if (slots_[at] == key) return false;
        slots_[at] = key;
        return true;
    }

private:
    std::vector<std::uint64_t> slots_;
};

std::uint64_t mixed(std::uint64_t x) {
    x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9ull;
    x = (x ^ x >> 27) * 0x94D049BB133111EBull;
    return x ^ x >> 31;
}

/// Key of a cell in the grid whose spacing is the largest power of two up to `size`. Two of 10^19
/// cells collide; a collision loses one point.
std::uint64_t cell_key(Vec3f p, float size) {
    const int level = std::ilogb(size);
    std::uint64_t key = mixed(static_cast<std::uint64_t>(level + 1000));
    for (int axis = 0; axis < 3; ++axis)
        key = mixed(key + std::bit_cast<std::uint64_t>(
                              std::floor(std::ldexp(static_cast<double>(p[axis]), -level)) + 0.0));
    return key;
}

/// Appends the points of a splat; `least`: minimum of its deviation along the normal; `reach`:
/// factor of the radii.
void append_points(
    const FieldSplats<Cpu>& splats, int i, float least, float reach, Pivots& pivots) {
    const Vec3f s = splats.scales[i], mean = splats.means[i];
    const int axis = smallest_axis(s);
    const float offset = kReach * std::max(s[axis], least);
    const float radius = std::max({kReach * std::max({s.x, s.y, s.z}), offset, reach});
    const Vec3f step = offset * column(rotation(splats.quats[i]), axis);
    for (const Vec3f p : {mean + step, mean - step}) {
        if (!is_finite(p)) continue;
        pivots.positions.push_back(p), pivots.splats.push_back(i);
        pivots.radii.push_back(kSlack * radius);
    }
}

}  // namespace

std::vector<float> pixel_footprints(const FieldSplats<Cpu>& splats,
                                    const FieldViews& views,
                                    const DepthRules& rules) {
    std::vector<float> footprints(splats.means.size(), 0);
    parallel_for(Cpu{}, splats.size(), [&](int i) {
        const Vec3f mean = splats.means[i];
        if (!is_finite(mean) || !(splats.opacities[i] >= kMinAlpha) ||
            !is_finite(splats.scales[i]) || !rules.in_box(mean))
            return;
        for (const View& view : views.views) {
            const Camera& c = view.camera;
            const Vec3f p = c.camera_from_world * mean;
            if (!(p.z > views.near && p.z < rules.depth_max) || !is_in_view(c, mean)) continue;
            const int x = static_cast<int>(c.fx_px * p.x / p.z + c.cx_px),
                      y = static_cast<int>(c.fy_px * p.y / p.z + c.cy_px);
            if (views.masks && !view.mask.empty() && view.mask.at(x, y) < kObjectMask) continue;
            const float footprint = p.z / c.fx_px;
            if (footprints[i] == 0 || footprint < footprints[i]) footprints[i] = footprint;
        }
    });
    return footprints;
}

std::vector<int> pivot_splats(const FieldSplats<Cpu>& splats,
                              const std::vector<float>& footprints,
                              float min_opacity) {
    std::vector<float> seen;
    for (std::size_t i = 0; i < footprints.size(); ++i)
        if (footprints[i] > 0) seen.push_back(splats.opacities[i]);
    if (!seen.empty()) min_opacity = std::min(min_opacity, middle_of(seen));
    Buffer<int, Cpu> order;
    morton_order(splats.means.span(), order);
    std::vector<int> chosen;
    for (const int i : order.span())
        if (footprints[i] > 0 && splats.opacities[i] >= min_opacity) chosen.push_back(i);
    return chosen;
}

std::optional<Pivots> surface_pivots(const FieldSplats<Cpu>& splats,
                                     const std::vector<int>& chosen,
                                     const std::vector<float>& footprints,
                                     float grain,
                                     std::size_t most) {
    const std::size_t room = std::min(most, 2 * chosen.size());
    SmallSet cells(room / 2 + 1);
    Pivots found;
    found.positions.reserve(room), found.radii.reserve(room), found.splats.reserve(room);
    for (const int i : chosen) {
        const float cell = footprints[i] * grain / 4;
        if (!cells.insert(cell_key(splats.means[i], cell))) continue;
        if (found.size() + 2 > most) return std::nullopt;
        append_points(splats, i, footprints[i] / 4, cell, found);
    }
    return found;
}

std::vector<Vec3i> snap_to_grid(const FieldSplats<Cpu>& splats,
                                const Contraction<double>& contraction,
                                Pivots& pivots) {
    // Bounds of the splats' centres, so that one huge splat costs the other points no precision.
    Vec3d low{INFINITY, INFINITY, INFINITY}, high = -low;
    for (const int splat : pivots.splats) {
        const Vec3d p = contraction.contract(vec_cast<double>(splats.means[splat]));
        for (int axis = 0; axis < 3; ++axis)
            low[axis] = std::min(low[axis], p[axis]), high[axis] = std::max(high[axis], p[axis]);
    }
    const Vec3d centre = 0.5 * (low + high), size = high - low;
    const double half = 0.5 * kBoxFactor * std::max({size.x, size.y, size.z});
    if (!(half > 0) || !std::isfinite(half)) return {};
    constexpr int kLast = (1 << kGridBits) - 1;
    const Vec3d origin = centre - Vec3d{half, half, half};
    const double step = 2 * half / kLast;
    std::vector<Vec3i> grid;
    grid.reserve(pivots.size() + 8);
    const auto place = [&](Vec3i cell) {
        return vec_cast<float>(contraction.expand(origin + step * vec_cast<double>(cell)));
    };
    std::size_t kept = 0;
    for (std::size_t i = 0; i < pivots.size(); ++i) {
        const Vec3d p =
            (contraction.contract(vec_cast<double>(pivots.positions[i])) - origin) / step;
        const double least = std::min({p.x, p.y, p.z}), most = std::max({p.x, p.y, p.z});
        if (!(least > 0.5 && most < kLast - 0.5)) continue;
        grid.push_back(vec_cast<int>(p + Vec3d{0.5, 0.5, 0.5}));
        pivots.positions[kept] = place(grid.back());
        pivots.radii[kept] = pivots.radii[i], pivots.splats[kept] = pivots.splats[i];
        ++kept;
    }
    pivots.positions.resize(kept), pivots.radii.resize(kept), pivots.splats.resize(kept);
    for (int corner = 0; corner < 8; ++corner) {
        const auto to = [&](int axis) { return corner >> axis & 1 ? kLast : 0; };
        grid.push_back({to(0), to(1), to(2)});
        pivots.positions.push_back(place(grid.back()));
        pivots.radii.push_back(0), pivots.splats.push_back(-1);
    }
    return grid;
}

}  // namespace tvsgs
