// Extracts a mesh from splats: renders depth maps, runs a mesher, cleans, repairs and simplifies
// the mesh. tvsgs-extract-mesh and --eval-mesh use it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/log.h"
#include "core/scene/scene.h"
#include "mesh/fuse/focus.h"
#include "mesh/fuse/large_splats.h"
#include "mesh/meshers_list.h"
#include "mesh/simplify/simplify.h"
#include "optim/loop/train.h"

namespace tvsgs {

/// Options of the extraction. They are part of the configuration, so that its files can store the
/// settings of published codes for each benchmark.
struct MeshOptions {
    std::string method = "tsdf";
    MesherOptions meshers;
    SimplifyOptions simplify{.error = 0.3f};
    float depth_max = 0, alpha_min = 0.5f, max_angle = 90, depth_step = 0, radius = 0, object = 0,
          max_scale_px = 0, measured = 0, holes = 20, smooth = 0.5f;
    int clusters = 0;
    bool masks = true, unbounded = false, evidence = true;
    std::string box, memory;

    /// Returns `unbounded`, but false for a watertight mesher, which ignores it.
    bool meshes_background() const;

    template <class Visitor>
    void fields(Visitor& field) {
        field("method", method,
              "mesher: tsdf, tetrahedra, or watertight, which closes unseen places too");
        meshers.fields(field);
        simplify.fields(field);
        field("depth_max", depth_max, {0, 1e9},
              "limit of depth; 0: twice the distance of the cameras' focus, or none if unbounded");
        field("unbounded", unbounded,
              "mesh the background, too, with voxels that grow outside of a ball around the "
              "cameras' focus");
        field("radius", radius, {0, 1e9},
              "radius of that ball; 0: the distance of the nearest camera");
        field("object", object, {0, 1e6},
              "mesh only the object, unless unbounded: a ball around the point that the cameras "
              "look at, in radii of the ball that the median camera sees whole; 0: everything");
        field("depth_step", depth_step, {0, 1e9},
              "round depths down to multiples of it, as PGSR's 0.001; 0: no rounding");
        field("box", box, "x0,y0,z0,x1,y1,z1: drop the surface outside; empty: no box");
        field("alpha_min", alpha_min, {0, 1}, "least coverage of a pixel; 0: any");
        field("max_angle", max_angle, {1, 90},
              "largest angle between ray and normal in degrees; 90: any");
        field("max_scale_px", max_scale_px, {0, 1e6},
              "skip splats with a larger standard deviation, in pixels of the camera with the "
              "finest ones there; 0: none");
        field("masks", masks, "drop pixels outside of the masks");
        field("evidence", evidence,
              "keep the components that views confirm, whatever their size, and remove unseen "
              "boundaries; counts the views of each vertex");
        field("measured", measured, {0, 1},
              "least share of the surface around a face, with mesh.evidence, that photographs of "
              "half of the views, and of two, show alike, or that such surface encloses; 0: keep "
              "everything");
        field("clusters", clusters, {0, 1e9},
              "number of largest components to keep, of at least 50 faces; 0: all");
        field("holes", holes, {0, 1000},
              "close holes of up to so many pixels of the nearest view unless a view contradicts; "
              "0: none");
        field("smooth", smooth, {0, 100},
              "smooth fused surfaces before simplification by up to so many pixels of the nearest "
              "view; keeps creases and boundaries; 0: none");
        field("memory", memory,
              "memory limit of the mesher, such as 8G; empty: a share of the free memory");
    }
};

/// The depth rules of the options; depth_max may be 0. `origin`: origin of the splats' frame in the
/// box's frame. Throws Error(ExitCode::usage).
DepthRules depth_rules(const MeshOptions& options, Vec3d origin = {});

/// Throws Error(ExitCode::usage) for options that are wrong for any scene, before hours of
/// training.
void check_mesh_options(const MeshOptions& options);

/// Counts for the messages of a command.
struct MeshSummary {
    std::size_t components = 0;          // of the mesh
    std::size_t removed_components = 0;  // all that were removed
    std::size_t small_components = 0;    // removed because they are too small in every view
    std::size_t closed_holes = 0;
    float object_radius = 0;  // of MeshOptions::object, world units; 0: everything
    double unmeasured = 0;    // share of the area that was removed because it is not measured
    std::string why_empty;    // how to get faces if there are none
};

namespace detail {

std::vector<Camera> cameras_of(const std::vector<View>& views);
/// The region to mesh; sets rules.depth_max if it is 0, and the ball of MeshOptions::object.
/// `focus` is used only if the region is unbounded, has a ball, or has no depth_max.
MeshRegion mesh_region(const MeshOptions& options,
                       const std::vector<Camera>& cameras,
                       const Focus& focus,
                       DepthRules& rules);
/// Memory limit of a mesher in bytes when `free_bytes` are free.
std::int64_t memory_of_mesher(const MeshOptions& options, std::int64_t free_bytes);
/// Removes components and counts them in `summary`. Returns why nothing is left; empty if something
/// is left, or the mesh was empty before.
std::string clean_mesh(TriangleMesh& mesh,
                       const MeshOptions& options,
                       const EvidenceSource& evidence,
                       MeshSummary& summary);

/// Removes surface that the photographs do not confirm, and fills `summary`. Returns why nothing is
/// left; empty in the same cases as clean_mesh().
std::string keep_measured(TriangleMesh& mesh,
                          const std::vector<View>& views,
                          const MeshOptions& options,
                          const EvidenceSource& evidence,
                          MeshSummary& summary);

/// Closes the small holes of a mesh and smooths its surface. Returns the number of closed holes.
std::size_t mend_mesh(TriangleMesh& mesh,
                      const std::vector<Camera>& cameras,
                      const MeshOptions& options,
                      const EvidenceSource& evidence);

/// The point that the cameras look at; warns if it is a guess.
template <class Device>
Focus focus_of_scene(const std::vector<View>& views,
                     const Gaussians<Device>& gaussians,
                     Backbone<Device>& backbone) {
    const std::vector<Camera> cameras = cameras_of(views);
    std::optional<Focus> focus = find_focus(cameras);
    if (!focus) {
        const auto& rendered = backbone.forward(gaussians, cameras.front(), gaussians.sh_degree,
                                                Maps::color | kGeometryMaps);
        focus = focus_at_depth(cameras, median_depth(to_host(rendered.depth)));
        spdlog::warn(
            "all cameras look in one direction: the object's distance is taken from the median "
            "depth of {}; see --depth-max",
            views.front().name);
    }
    spdlog::debug("Object at ({:.4g}, {:.4g}, {:.4g}), nearest camera {:.4g} units away",
                  focus->point.x, focus->point.y, focus->point.z, focus->radius);
    return *focus;
}

}  // namespace detail

/// Extracts the mesh that `views` see, with the backbone of `train` and the mesher of `options`.
/// Data that exceed the memory limit are stored in `spill_folder` until this returns. Logs details
/// at level debug. Fills `summary`; if that is null, warns about an empty mesh. Throws Error.
template <class Device>
TriangleMesh extract_mesh(const std::vector<View>& views,
                          const Gaussians<Device>& all,
                          const TrainOptions& train,
                          const MeshOptions& options,
                          const std::string& spill_folder,
                          Vec3d origin = {},
                          MeshSummary* summary = nullptr) {
    MeshSummary counts;
    const auto backbone = make_backbone<Device>(train.backbone, train.render);
    const auto mesher = make_mesher<Device>(options.method, options.meshers);
    Gaussians<Device> meshed;
    std::string none_left;
    if (options.max_scale_px > 0) {
        copy(all, meshed);
        const std::size_t faded =
            fade_large(detail::cameras_of(views), options.max_scale_px, meshed);
        spdlog::debug("Skipped {} of {} splats larger than {} pixels (mesh.max_scale_px)", faded,
                      all.size(), options.max_scale_px);
        if (faded == all.means.size())
            none_left = str("all ", faded, " splats are larger than ", options.max_scale_px,
                            " pixels (mesh.max_scale_px); raise it, or set it to 0");
    }
    const Gaussians<Device>& gaussians = meshed.size() > 0 ? meshed : all;
    DepthRules rules = depth_rules(options, origin);
    Focus focus{};
    if (options.depth_max == 0 || options.meshes_background() || options.object > 0)
        focus = detail::focus_of_scene(views, all, *backbone);
    const std::vector<Camera> cameras = detail::cameras_of(views);
    const MeshRegion region = detail::mesh_region(options, cameras, focus, rules);
    counts.object_radius = rules.reach;
    DepthViews<Device> depth(views, gaussians, *backbone, rules, options.masks);
    ExtractedMesh found =
        mesher->extract({views, gaussians, *backbone, depth, region, train.render.near,
                         detail::memory_of_mesher(options, free_bytes(Device{})), spill_folder});
    const EvidenceSource evidence = evidence_of(depth);
    std::string emptied;
    if (!mesher->is_closed())
        emptied = detail::keep_measured(found.mesh, views, options, evidence, counts);
    if (emptied.empty()) emptied = detail::clean_mesh(found.mesh, options, evidence, counts);
    MeshOptions mending = options;
    if (!mesher->is_rough()) mending.smooth = 0;
    if (!mesher->is_closed())
        counts.closed_holes = detail::mend_mesh(found.mesh, cameras, mending, evidence);
    const std::string simplified = simplify_and_log(found.mesh, cameras, options.simplify);
    if (emptied.empty()) emptied = simplified;
    if (options.evidence || mesher->is_closed()) count_views(found.mesh, evidence);
    counts.why_empty = !none_left.empty()        ? none_left
                       : found.why_empty.empty() ? emptied
                                                 : found.why_empty;
    if (!summary && !counts.why_empty.empty()) spdlog::warn("Empty mesh: {}", counts.why_empty);
    if (summary) *summary = counts;
    return std::move(found.mesh);
}

}  // namespace tvsgs
