#include "pipeline/mesh/mesh_extraction.h"

#include <cmath>
#include <limits>

#include "core/grouped.h"
#include "core/parse_numbers.h"
#include "io/files/read_file.h"
#include "mesh/mend/mend.h"

namespace tvsgs {
namespace {

constexpr double kShareOfFreeMemory = 0.8;  // the rest is for images and the mesh itself

void add_part(std::string& list, std::size_t count, const char* what) {
    if (count > 0) list += str(list.empty() ? "" : ", ", grouped(count), " ", what);
}

}  // namespace

bool MeshOptions::meshes_background() const {
    return unbounded && !make_mesher<Cpu>(method, meshers)->is_closed();
}

DepthRules depth_rules(const MeshOptions& options, Vec3d origin) {
    DepthRules rules;
    rules.depth_max = options.depth_max, rules.alpha_min = options.alpha_min;
    rules.depth_step = options.depth_step;
    if (options.max_angle < 90) rules.min_cosine = std::cos(options.max_angle * float(M_PI / 180));
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

MeshRegion mesh_region(const MeshOptions& options,
                       const std::vector<Camera>& cameras,
                       const Focus& focus,
                       DepthRules& rules) {
    const bool unbounded = options.meshes_background();
    if (options.object > 0 && !unbounded) {
        rules.centre = vec_cast<float>(focus.point);
        rules.reach = options.object * float(common_radius(cameras, focus));
        if (!(rules.reach > 0))
            throw Error(ExitCode::usage,
                        "mesh.object: the cameras look at no common point; pass --everything");
    }
    const float radius = unbounded && options.radius > 0 ? options.radius : float(focus.radius);
    if ((unbounded || rules.depth_max == 0) && !(radius > 0))
        throw input_error(
            "unknown size of the scene: a camera is at the point that all cameras look at; pass ",
            unbounded ? "--set mesh.radius=R" : "--depth-max");
    if (rules.depth_max == 0)
        rules.depth_max =
            unbounded ? std::numeric_limits<float>::max() : float(kDepthLimit) * radius;
    return {unbounded, vec_cast<float>(focus.point), radius};
}

std::int64_t memory_of_mesher(const MeshOptions& options, std::int64_t free_bytes) {
    return !options.memory.empty() ? parse_bytes("--memory", options.memory)
                                   : std::int64_t(kShareOfFreeMemory * double(free_bytes));
}

std::string keep_measured(TriangleMesh& mesh,
                          const std::vector<View>& views,
                          const MeshOptions& options,
                          const EvidenceSource& evidence,
                          MeshSummary& summary) {
    if (!options.evidence || options.measured == 0 || mesh.faces.empty()) return {};
    const MeasuredReport report = keep_measured_faces(mesh, evidence, views, options.measured);
    summary.unmeasured = report.removed_area;
    spdlog::debug("Removed {} faces that the photographs do not confirm, {:.1f} % of the surface",
                  grouped(report.removed_faces), 100 * report.removed_area);
    return mesh.faces.empty() ? "the photographs do not confirm any surface; use more views or "
                                "more texture, or keep everything (mesh.measured=0)"
                              : "";
}

std::string clean_mesh(TriangleMesh& mesh,
                       const MeshOptions& options,
                       const EvidenceSource& evidence,
                       MeshSummary& summary) {
    if (options.evidence && !mesh.faces.empty()) {
        const EvidenceReport seen = keep_seen_components(mesh, evidence);
        summary.components = seen.kept_components;
        summary.removed_components = seen.components - seen.kept_components;
        summary.small_components =
            summary.removed_components - seen.looked_through - seen.single_view;
        std::string removed;
        add_part(removed, summary.small_components, "too small");
        add_part(removed, seen.looked_through, "looked through by a view");
        add_part(removed, seen.single_view, "seen by a single view");
        if (seen.peeled_faces > 0)
            spdlog::debug("Removed {} unseen faces at boundaries", grouped(seen.peeled_faces));
        spdlog::debug("Kept {} of {} components{}", seen.kept_components, seen.components,
                      removed.empty() ? "" : "; removed: " + removed);
        if (mesh.faces.empty())
            return str("views confirm none of its ", seen.components, " components (", removed,
                       "); use more views, or pass --set mesh.evidence=false");
    }
    if (options.evidence && options.clusters == 0) return {};
    const CleanReport cleaned = keep_largest_components(mesh, options.clusters);
    summary.components = cleaned.kept_components;
    summary.removed_components += cleaned.components - cleaned.kept_components;
    spdlog::debug("Kept {} of {} components; removed {} faces and {} vertices",
                  cleaned.kept_components, cleaned.components, grouped(cleaned.removed_faces),
                  grouped(cleaned.removed_vertices));
    if (!mesh.faces.empty() || cleaned.components == 0) return {};
    return str("all ", cleaned.components,
               " components have fewer than 50 faces; lower --voxel-size, or pass --clusters 0");
}

std::size_t mend_mesh(TriangleMesh& mesh,
                      const std::vector<Camera>& cameras,
                      const MeshOptions& options,
                      const EvidenceSource& evidence) {
    if (mesh.faces.empty() || !(options.holes > 0 || options.smooth > 0)) return 0;
    const ManifoldReport repaired = make_manifold(mesh);
    if (repaired.dropped_faces > 0 || repaired.split_vertices > 0)
        spdlog::debug("Dropped {} degenerate or repeated faces, split {} non-manifold vertices",
                      repaired.dropped_faces, repaired.split_vertices);
    const HoleReport holes = close_holes(mesh, repaired.edges, cameras, evidence, options.holes);
    if (options.holes > 0) {
        std::string left;
        add_part(left, holes.contradicted, "that photographs look through");
        add_part(left, holes.unfit, "that nothing fits");
        spdlog::debug("Closed {} small holes with {} faces{}", holes.closed, holes.faces,
                      left.empty() ? "" : "; left " + left);
    }
    if (const std::size_t moved = smooth_surface(mesh, cameras, options.smooth))
        spdlog::debug("Smoothed: moved {} of {} vertices by up to {} px", grouped(moved),
                      grouped(mesh.vertices.size()), options.smooth);
    return holes.closed;
}

}  // namespace detail
}  // namespace tvsgs
