#include "mesh/tetrahedra/mesher_tetrahedra.h"

#include "core/error.h"
#include "core/log.h"
#include "mesh/fuse/device_algorithms.h"
#include "render/tiles/sh_math.h"

namespace tvsgs::detail {
namespace {

constexpr float kGrainGrowth = 1.5f;

std::size_t most_points(std::int64_t max_bytes, int splats) {
    const std::int64_t budget = host_budget(max_bytes);
    const std::int64_t of_splats = std::int64_t{kFieldBytesPerSplat} * splats;
    const std::int64_t most = (budget - of_splats) / kPivotBytes;
    constexpr std::int64_t kMin = 64, kMax = 1 << 27;  // limit of the numbering of tetrahedra
    if (most < kMin)
        throw Error(ExitCode::memory, "a mesh of ", splats, " splats needs at least ",
                    of_splats + kMin * kPivotBytes, " bytes; ", budget,
                    " are available; raise --memory");
    return static_cast<std::size_t>(std::min(most, kMax));
}

}  // namespace

PivotTetrahedra pivot_tetrahedra(const FieldSplats<Cpu>& splats,
                                 const FieldViews& views,
                                 const TetrahedraMesherOptions& options,
                                 const DepthRules& rules,
                                 const MeshRegion& region,
                                 std::int64_t max_bytes) {
    PivotTetrahedra made;
    const std::size_t most = most_points(max_bytes, splats.size());
    const std::vector<float> footprints = pixel_footprints(splats, views, rules);
    const std::vector<int> chosen = pivot_splats(splats, footprints, options.min_opacity);
    float grain = 1;
    auto found = surface_pivots(splats, chosen, footprints, grain, most);
    const bool fits = found.has_value();
    while (!found) found = surface_pivots(splats, chosen, footprints, grain *= kGrainGrowth, most);
    made.pivots = std::move(*found);
    if (!fits)
        spdlog::debug("Merged points within {:.3g} px to stay within --memory: {} of {} left",
                      grain / 4, made.pivots.size(), 2 * chosen.size());
    if (made.pivots.size() == 0) {
        made.why_empty =
            str("none of the ", splats.size(),
                " splats is in the image of a view; raise --depth-max, or check the masks "
                "(--no-masks) and --bbox");
        return made;
    }
    Contraction<double> contraction;
    if (region.unbounded)
        contraction = {vec_cast<double>(region.centre), static_cast<double>(region.radius)};
    const std::vector<Vec3i> grid = snap_to_grid(splats, contraction, made.pivots);
    if (!grid.empty()) made.tetrahedra = delaunay(grid);
    if (made.tetrahedra.empty()) made.why_empty = "all splats are in one point";
    spdlog::debug("Tetrahedra: {} between {} points of {} splats", made.tetrahedra.size(),
                  made.pivots.size(), splats.size());
    return made;
}

TetrahedraSurface crossed_tetrahedra(const PivotTetrahedra& points,
                                     const std::vector<Sight>& sights) {
    std::vector<PointSide> sides;
    sides.reserve(sights.size());
    for (const Sight& sight : sights)
        sides.push_back(sight.views == 0  ? PointSide::unseen
                        : !is_free(sight) ? PointSide::inside
                                          : PointSide::free);
    TetrahedraSurface surface =
        marching_tetrahedra(points.tetrahedra, sides, points.pivots.positions, points.pivots.radii);
    spdlog::debug("{} faces; omitted {} between distant splats and {} next to unseen points",
                  surface.faces.size(), surface.far_faces, surface.unseen_faces);
    return surface;
}

std::vector<Vec3f> mean_colors(const std::vector<ColorSum>& sums,
                               const std::vector<CrossedEdge>& edges,
                               const std::vector<int>& splats,
                               const std::vector<Vec3f>& base_sh) {
    std::vector<Vec3f> colors;
    colors.reserve(sums.size());
    for (std::size_t i = 0; i < sums.size(); ++i) {
        Vec3f c{};
        if (sums[i].weight > 0) {
            c = sums[i].color / sums[i].weight;
        } else {
            const int inside = splats[edges[i].inside_end];
            const int splat = inside >= 0 ? inside : splats[edges[i].free_end];
            if (splat >= 0)
                c = static_cast<float>(kShC0) * base_sh[splat] + Vec3f{0.5f, 0.5f, 0.5f};
        }
        for (int k = 0; k < 3; ++k) c[k] = c[k] > 0 ? std::min(c[k], 1.0f) : 0;
        colors.push_back(c);
    }
    return colors;
}

}  // namespace tvsgs::detail
