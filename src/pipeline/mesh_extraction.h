// Splats to mesh: renders the depth of views, fuses it, cleans the surface. What tvsgs-extract-mesh
// and --eval-mesh share.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/log.h"
#include "core/scene.h"
#include "mesh/depth_clean.h"
#include "mesh/device_algorithms.h"
#include "mesh/focus.h"
#include "mesh/fusion.h"
#include "mesh/mesh_clean.h"
#include "optim/train.h"

namespace tvsgs {

/// In the configuration, so that overlays can hold what the published codes use per benchmark.
struct MeshOptions {
    float voxel_size = 0, truncation = 0, truncation_voxels = 4, depth_max = 0, alpha_min = 0.5f,
          max_angle = 90, depth_step = 0, radius = 0;
    int resolution = 0, min_weight = 1, clusters = 50;
    bool masks = true, unbounded = false, carve = false;
    DepthWeighting weight = DepthWeighting::unit;
    std::string box, memory;

    template <class Visitor>
    void fields(Visitor& field) {
        field("voxel_size", voxel_size, {0, 1e9}, "world units; 0: depth_max / resolution");
        field("resolution", resolution, {0, 65536},
              "voxels along depth_max, or across the ball if unbounded; 0: 2048, fewer for small "
              "images");
        field("truncation", truncation, {0, 1e9}, "world units; 0: truncation_voxels");
        field("truncation_voxels", truncation_voxels, {1, 1000}, "truncation in voxels");
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
        field("masks", masks, "drop what lies outside of the masks");
        field.choice("weight", weight, {"unit", "inv-depth2", "cos"},
                     "of a pixel in the means: 1, 1 / depth^2, or cosine between ray and normal");
        field("carve", carve,
              "views also clear the space before their surfaces where others have put some");
        field("min_weight", min_weight, {1, 65535},
              "views that must have seen a voxel; needs weight unit if above 1");
        field("clusters", clusters, {0, 1e9}, "largest components to keep; 0: all");
        field("memory", memory, "bytes for the volume, as 8G; empty: a share of what is free");
    }
};

/// The rules of the options; depth_max may be 0. `origin`: of the splats' frame in that of the box.
/// Throws Error(ExitCode::usage).
DepthRules depth_rules(const MeshOptions& options, Vec3d origin = {});

/// Error(ExitCode::usage) for what is wrong whatever the scene, to be said before hours of
/// training.
void check_mesh_options(const MeshOptions& options);

namespace detail {

double median_depth(std::vector<float> depths);  // of those that are there; 0 without any
std::vector<Camera> cameras_of(const std::vector<View>& views);
/// Completes `rules`. `focus` counts if unbounded, or where there is no depth_max.
TsdfOptions volume_options(const MeshOptions& options,
                           const std::vector<View>& views,
                           const Focus& focus,
                           std::int64_t free_bytes,
                           spdlog::level::level_enum level,
                           DepthRules& rules);
void check_truncation(const Camera& camera, std::vector<float> depths, const TsdfOptions& volume);
void report_fusion(const DepthCounts& counts,
                   const DepthRules& rules,
                   const FusionReport& fusion,
                   spdlog::level::level_enum level);
/// Why no pixel was fused; empty if one was.
std::string why_nothing_fused(const DepthCounts& counts,
                              const DepthRules& rules,
                              double median_depth);
/// Why cleaning left nothing; empty if it left something, or there was nothing before.
std::string clean_mesh(TriangleMesh& mesh, int clusters, spdlog::level::level_enum level);

/// What the views look at, which comes with a warning where this is a guess.
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

/// The mesh that `views` see, by the backbone of `train`. What does not fit into the budget of
/// memory is kept in `spill_folder` meanwhile. What was done is said at `level`. Why a mesh is
/// empty is put into `why_empty`, or is a warning without it. Throws Error.
template <class Device>
TriangleMesh extract_mesh(const std::vector<View>& views,
                          const Gaussians<Device>& gaussians,
                          const TrainOptions& train,
                          const MeshOptions& options,
                          const std::string& spill_folder,
                          spdlog::level::level_enum level = spdlog::level::info,
                          Vec3d origin = {},
                          std::string* why_empty = nullptr) {
    const auto backbone = make_backbone<Device>(train.backbone, train.core);
    DepthRules rules = depth_rules(options, origin);
    Focus focus{};
    if (options.depth_max == 0 || options.unbounded)
        focus = detail::focus_of_scene(views, gaussians, *backbone, level);
    const TsdfOptions volume =
        detail::volume_options(options, views, focus, free_bytes(Device{}), level, rules);

    std::vector<DepthCounts> counts(views.size());  // views may be asked for twice
    CleanDepth<Device> clean;
    Buffer<std::uint8_t, Device> mask;
    double median = 0;
    bool checked = false;
    const auto source = [&](int i) -> DepthView<Device> {
        const View& view = views[static_cast<std::size_t>(i)];
        DepthCounts& count = counts[static_cast<std::size_t>(i)];
        const auto& rendered = backbone->forward(gaussians, view.camera, gaussians.sh_degree,
                                                 Maps::color | kGeometryMaps);
        const Camera& camera = rendered.camera;  // that of the depths
        copy(options.masks ? view.mask.pixels : std::vector<std::uint8_t>(), mask);
        count = clean_depth(rendered, camera, std::as_const(mask).span(), rules, clean);
        if (!checked && count.kept > 0) {
            detail::check_truncation(camera, to_host(clean.depth), volume);
            checked = true;
        }
        if (count.kept == 0) median = detail::median_depth(to_host(rendered.depth));
        return {camera, std::as_const(clean.depth).span(), rendered.color.span(),
                std::as_const(clean.weight).span()};
    };
    FusionReport fusion;
    const bool counted = options.weight == DepthWeighting::unit;
    TriangleMesh mesh = fuse_views<Device>(static_cast<int>(views.size()), source, volume,
                                           counted ? static_cast<float>(options.min_weight) : 0,
                                           spill_folder, fusion);
    DepthCounts total;
    for (const DepthCounts& count : counts) total += count;
    detail::report_fusion(total, rules, fusion, level);
    std::string why = detail::why_nothing_fused(total, rules, median);
    if (why.empty() && mesh.faces.empty())
        why = "no two views, or too few pixels, agree on a surface; lower --min-weight";
    const std::string cleaned = detail::clean_mesh(mesh, options.clusters, level);
    if (why.empty()) why = cleaned;
    if (why_empty)
        *why_empty = why;
    else if (!why.empty())
        spdlog::warn("empty mesh: {}", why);
    return mesh;
}

}  // namespace tvsgs
