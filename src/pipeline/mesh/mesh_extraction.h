// Extracts a mesh from splats: renders the depth of views, runs a mesher, cleans and simplifies.
// Shared by tvsgs-extract-mesh and --eval-mesh.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/log.h"
#include "core/scene/scene.h"
#include "mesh/fuse/focus.h"
#include "mesh/fuse/large_splats.h"
#include "mesh/mend/mesh_clean.h"
#include "mesh/meshers_list.h"
#include "mesh/simplify/simplify.h"
#include "optim/loop/train.h"

namespace tvsgs {

/// In the configuration, so that overlays can hold the published settings of a benchmark.
struct MeshOptions {
    std::string method = "tsdf";
    MesherOptions meshers;
    SimplifyOptions simplify{.error = 0.3f};
    float depth_max = 0, alpha_min = 0.5f, max_angle = 90, depth_step = 0, radius = 0,
          max_scale_px = 0, holes = 20, smooth = 0.5f;
    int clusters = 0;
    bool masks = true, unbounded = false, evidence = true;
    std::string box, memory;

    /// A watertight mesh ignores `unbounded`.
    bool meshes_background() const;

    template <class Visitor>
    void fields(Visitor& field) {
        field("method", method,
              "what makes the surface of the splats: tsdf, tetrahedra, watertight");
        meshers.fields(field);
        simplify.fields(field);
        field("depth_max", depth_max, {0, 1e9},
              "depths from there on are dropped; 0: twice the distance of the cameras' focus, or "
              "none if unbounded");
        field("unbounded", unbounded,
              "mesh the background as well, in voxels that grow outside of a ball about the "
              "cameras' focus");
        field("radius", radius, {0, 1e9}, "of that ball; 0: the distance of the nearest camera");
        field("depth_step", depth_step, {0, 1e9},
              "depths are rounded down to multiples of it, as PGSR's 0.001; 0: not");
        field("box", box, "x0,y0,z0,x1,y1,z1: surface outside is dropped; empty: none");
        field("alpha_min", alpha_min, {0, 1}, "least coverage of a pixel; 0: any");
        field("max_angle", max_angle, {1, 90},
              "degrees between ray and normal, surface seen at a larger one is dropped; 90: none");
        field("max_scale_px", max_scale_px, {0, 1e6},
              "splats with a larger standard deviation are not meshed, pixels of the camera whose "
              "are finest there; 0: all are");
        field("masks", masks, "drop what lies outside of the masks");
        field("evidence", evidence,
              "keep the components that views bear out, whatever their size, and cut off what no "
              "view sees; counts the views of each vertex");
        field("clusters", clusters, {0, 1e9},
              "largest components to keep, of 50 faces and more; 0: all");
        field("holes", holes, {0, 1000},
              "holes of up to that many pixels of the nearest view are closed where no view "
              "contradicts; 0: none");
        field(
            "smooth", smooth, {0, 100},
            "roughness of what is fused comes off before simplification, by up to that many pixels "
            "of the nearest view; creases and boundaries stay; 0: none");
        field("memory", memory, "bytes for the volume, as 8G; empty: a share of what is free");
    }
};

/// The depth rules of the options; depth_max may be 0. `origin`: of the splats' frame in the frame
/// of the box. Throws Error(ExitCode::usage).
DepthRules depth_rules(const MeshOptions& options, Vec3d origin = {});

/// Throws Error(ExitCode::usage) for options that are wrong for every scene.
void check_mesh_options(const MeshOptions& options);

namespace detail {

std::vector<Camera> cameras_of(const std::vector<View>& views);
/// The region to mesh; sets rules.depth_max if it is 0. Uses `focus` only for an unbounded mesh or
/// without depth_max.
MeshRegion mesh_region(const MeshOptions& options, const Focus& focus, DepthRules& rules);
/// Bytes of memory that a mesher may use when `free_bytes` are free.
std::int64_t memory_of_mesher(const MeshOptions& options, std::int64_t free_bytes);
/// Cleans the mesh. Returns why no face remains; empty if faces remain, or there were none before.
std::string clean_mesh(TriangleMesh& mesh,
                       const MeshOptions& options,
                       const EvidenceSource& evidence,
                       spdlog::level::level_enum level);

/// Closes the small holes of a mesh and smooths its surface.
void mend_mesh(TriangleMesh& mesh,
               const std::vector<Camera>& cameras,
               const MeshOptions& options,
               const EvidenceSource& evidence,
               spdlog::level::level_enum level);

/// The point that the views look at; warns where it is a guess.
template <class Device>
Focus focus_of_scene(const std::vector<View>& views,
                     const Gaussians<Device>& gaussians,
                     Backbone<Device>& backbone,
                     spdlog::level::level_enum level) {
    const std::vector<Camera> cameras = cameras_of(views);
    std::optional<Focus> focus = find_focus(cameras);
    if (!focus) {
        const auto& rendered = backbone.forward(gaussians, cameras.front(), gaussians.sh_degree,
                                                Maps::color | kGeometryMaps);
        focus = focus_at_depth(cameras, median_depth(to_host(rendered.depth)));
        spdlog::warn(
            "the optical axes are parallel: what they look at is taken to be at the median depth "
            "of {}; see --depth-max",
            views.front().name);
    }
    spdlog::log(level, "cameras look at ({:.4g}, {:.4g}, {:.4g}), the nearest from {:.4g}",
                focus->point.x, focus->point.y, focus->point.z, focus->radius);
    return *focus;
}

}  // namespace detail

/// Extracts the mesh seen by `views`, with the backbone of `train` and the mesher of `options`.
/// Data beyond the memory budget go to `spill_folder` until this returns. Logs messages at `level`.
/// Stores the reason for an empty mesh in `why_empty`, or logs a warning if that is null. Throws
/// Error.
template <class Device>
TriangleMesh extract_mesh(const std::vector<View>& views,
                          const Gaussians<Device>& all,
                          const TrainOptions& train,
                          const MeshOptions& options,
                          const std::string& spill_folder,
                          spdlog::level::level_enum level = spdlog::level::info,
                          Vec3d origin = {},
                          std::string* why_empty = nullptr) {
    const auto backbone = make_backbone<Device>(train.backbone, train.render);
    const auto mesher = make_mesher<Device>(options.method, options.meshers);
    Gaussians<Device> small;
    std::string too_large;
    if (options.max_scale_px > 0) {
        copy(all, small);
        const std::size_t faded =
            fade_large(detail::cameras_of(views), options.max_scale_px, small);
        const std::string what = str(faded, " of ", all.size(), " splats are larger than ",
                                     options.max_scale_px, " pixels (mesh.max_scale_px)");
        spdlog::log(level, "{}: not meshed", what);
        if (faded == all.means.size()) too_large = str(what, "; raise it, or 0 to mesh them");
    }
    const Gaussians<Device>& gaussians = options.max_scale_px > 0 ? small : all;
    DepthRules rules = depth_rules(options, origin);
    Focus focus{};
    if (options.depth_max == 0 || options.meshes_background())
        focus = detail::focus_of_scene(views, all, *backbone, level);
    const MeshRegion region = detail::mesh_region(options, focus, rules);
    DepthViews<Device> depth(views, gaussians, *backbone, rules, options.masks);
    ExtractedMesh found = mesher->extract(
        {views, gaussians, *backbone, depth, region, train.render.near,
         detail::memory_of_mesher(options, free_bytes(Device{})), spill_folder, level});
    const EvidenceSource evidence = evidence_of(depth);
    std::string emptied = detail::clean_mesh(found.mesh, options, evidence, level);
    const std::vector<Camera> cameras = detail::cameras_of(views);
    MeshOptions mending = options;
    if (!mesher->is_rough()) mending.smooth = 0;
    if (!mesher->is_closed()) detail::mend_mesh(found.mesh, cameras, mending, evidence, level);
    const std::string simplified = simplify_and_log(found.mesh, cameras, options.simplify, level);
    if (emptied.empty()) emptied = simplified;
    if (options.evidence || mesher->is_closed()) count_views(found.mesh, evidence);
    const std::string& why = !too_large.empty()        ? too_large
                             : found.why_empty.empty() ? emptied
                                                       : found.why_empty;
    if (why_empty)
        *why_empty = why;
    else if (!why.empty())
        spdlog::warn("empty mesh: {}", why);
    return std::move(found.mesh);
}

}  // namespace tvsgs
