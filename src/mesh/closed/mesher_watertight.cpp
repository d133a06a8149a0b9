#include "mesh/closed/mesher_watertight.h"

#include "core/device/parallel.h"
#include "core/log.h"
#include "core/math/point_tree.h"

namespace tvsgs::detail {

ExtractedMesh close_surface(const ViewPoints& points,
                            const EvidenceSource& evidence,
                            std::int64_t max_bytes) {
    ExtractedMesh found;
    const OrientedPoints oriented = points.oriented();
    if (oriented.size() == 0) {
        found.why_empty =
            "no view has trusted pixels on a surface that no other view looks through; are the "
            "splats opaque?";
        return found;
    }
    const PoissonField field = solve_poisson(oriented, evidence, {points.cell(), max_bytes});
    spdlog::debug(
        "Watertight: {} points ({} isolated; {} dropped because views look through them); finest "
        "nodes {:.4g} apart, {} levels, {:.1f} MiB",
        oriented.size(), field.isolated, points.dropped(), field.finest().spacing,
        field.levels.size(), static_cast<double>(field.bytes) / (1 << 20));
    found.mesh = poisson_surface(field, max_bytes);
    if (found.mesh.faces.empty()) {
        found.why_empty = str(oriented.size(),
                              " trusted points enclose no solid; use more views, or --method tsdf");
        return found;
    }
    const std::vector<Vec3f> colors = points.colors();
    const PointTree<float> tree(oriented.positions);
    found.mesh.colors.resize(found.mesh.vertices.size());
    parallel_for(Cpu{}, static_cast<int>(found.mesh.vertices.size()), [&](int v) {
        std::size_t nearest = 0;
        float squared;
        tree.nearest(found.mesh.vertices[v], 1, &nearest, &squared);
        found.mesh.colors[v] = colors[nearest];
    });
    return found;
}

}  // namespace tvsgs::detail
