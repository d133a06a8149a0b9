#include "pipeline/mesh/mesh_extraction.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/error.h"
#include "core/log.h"
#include "core/parse_numbers.h"
#include "mesh/mend/mesh_holes.h"
#include "mesh/mend/mesh_manifold.h"
#include "mesh/mend/mesh_smooth.h"

namespace tvsgs {
namespace {

constexpr double kShareOfFreeMemory = 0.8;  // the rest is for images and the mesh itself

}  // namespace

bool MeshOptions::meshes_background() const {
    return unbounded && !make_mesher<Cpu>(method, meshers)->is_closed();
}

DepthRules depth_rules(const MeshOptions& options, Vec3d origin) {
    DepthRules rules;
    rules.depth_max = options.depth_max, rules.alpha_min = options.alpha_min;
    rules.depth_step = options.depth_step;
    if (options.max_angle < 90)
        rules.min_cosine = std::cos(options.max_angle * static_cast<float>(M_PI / 180));
    if (!options.box.empty()) {
        const Box3d box = parse_box("--bbox", options.box);
        rules.has_box = true;
        rules.box_min = vec_cast<float>(box.low - origin);
        rules.box_max = vec_cast<float>(box.high - origin);
    }
    return rules;
}

void check_mesh_options(const MeshOptions& options) {
    make_mesher<Cpu>(options.method, options.meshers);
    depth_rules(options);
    if (!options.memory.empty()) parse_bytes("--memory", options.memory);
}

namespace detail {

std::vector<Camera> cameras_of(const std::vector<View>& views) {
    std::vector<Camera> cameras;
    for (const View& view : views) cameras.push_back(view.camera);
    return cameras;
}

MeshRegion mesh_region(const MeshOptions& options, const Focus& focus, DepthRules& rules) {
    const bool unbounded = options.meshes_background();
    const float radius =
        unbounded && options.radius > 0 ? options.radius : static_cast<float>(focus.radius);
    if ((unbounded || rules.depth_max == 0) && !(radius > 0))
        throw Error(ExitCode::input,
                    str("the size of the scene cannot be found: a camera lies in the point that "
                        "all look at; give ",
                        unbounded ? "--set mesh.radius=R" : "--depth-max"));
    if (rules.depth_max == 0)
        rules.depth_max = unbounded ? std::numeric_limits<float>::max()
                                    : static_cast<float>(kDepthLimit) * radius;
    return {unbounded, vec_cast<float>(focus.point), radius};
}

std::int64_t memory_of_mesher(const MeshOptions& options, std::int64_t free_bytes) {
    return !options.memory.empty()
               ? parse_bytes("--memory", options.memory)
               : static_cast<std::int64_t>(kShareOfFreeMemory * static_cast<double>(free_bytes));
}

std::string clean_mesh(TriangleMesh& mesh,
                       const MeshOptions& options,
                       const EvidenceSource& evidence,
                       spdlog::level::level_enum level) {
    if (options.evidence && !mesh.faces.empty()) {
        const EvidenceReport seen = keep_seen_components(mesh, evidence);
        const std::size_t small =
            seen.components - seen.kept_components - seen.looked_through - seen.single_view;
        const std::string dropped =
            str(seen.looked_through, " that a view looks through, ", seen.single_view,
                " that one view alone sees, ", small, " of less than 20 pixels in every view");
        spdlog::log(level,
                    "{} faces at boundaries that no view sees; of {} components {} stay, not {}",
                    seen.peeled_faces, seen.components, seen.kept_components, dropped);
        if (mesh.faces.empty())
            return str("the views bear out none of its ", seen.components, " components: ", dropped,
                       "; give more views, or --set mesh.evidence=false");
    }
    if (options.evidence && options.clusters == 0) return {};
    const CleanReport cleaned = keep_largest_components(mesh, options.clusters);
    spdlog::log(level, "{} components, {} kept; {} faces and {} vertices removed",
                cleaned.components, cleaned.kept_components, cleaned.removed_faces,
                cleaned.removed_vertices);
    if (!mesh.faces.empty() || cleaned.components == 0) return {};
    return str("all ", cleaned.components,
               " components have fewer than 50 faces; lower --voxel-size, or pass --clusters 0");
}

void mend_mesh(TriangleMesh& mesh,
               const std::vector<Camera>& cameras,
               const MeshOptions& options,
               const EvidenceSource& evidence,
               spdlog::level::level_enum level) {
    if (mesh.faces.empty() || !(options.holes > 0 || options.smooth > 0)) return;
    const ManifoldReport sound = make_manifold(mesh);
    if (sound.dropped_faces > 0 || sound.split_vertices > 0)
        spdlog::log(level, "{} faces were none or there twice, {} vertices split where sheets met",
                    sound.dropped_faces, sound.split_vertices);
    const HoleReport holes = close_holes(mesh, sound.edges, cameras, evidence, options.holes);
    if (options.holes > 0)
        spdlog::log(
            level,
            "of {} boundary loops {} holes of up to {} pixels are closed with {} faces, not "
            "{} that a view contradicts, {} that nothing fits",
            holes.loops, holes.closed, options.holes, holes.faces, holes.contradicted, holes.unfit);
    if (const std::size_t moved = smooth_surface(mesh, cameras, options.smooth))
        spdlog::log(level, "{} of {} vertices moved by up to {} pixels, to be smooth", moved,
                    mesh.vertices.size(), options.smooth);
}

}  // namespace detail
}  // namespace tvsgs
