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
    float voxel_size = 0, truncation = 0, depth_max = 0, alpha_min = 0.5f, max_angle = 90,
          depth_step = 0;
    int resolution = 0, min_weight = 1, clusters = 50;
    bool masks = true;
    std::string box, memory;

    template <class Visitor>
    void fields(Visitor& field) {
        field("voxel_size", voxel_size, {0, 1e9}, "world units; 0: depth_max / resolution");
        field("resolution", resolution, {0, 65536},
              "voxels along depth_max; 0: 1024, fewer for small images");
        field("truncation", truncation, {0, 1e9}, "world units; 0: 5 voxels");
        field("depth_max", depth_max, {0, 1e9},
              "depths from there on are dropped; 0: twice the distance of the cameras' focus");
        field("depth_step", depth_step, {0, 1e9},
              "depths are rounded down to multiples of it, as PGSR's 0.001; 0: not");
        field("box", box, "x0,y0,z0,x1,y1,z1: surface outside is dropped; empty: none");
        field("alpha_min", alpha_min, {0, 1}, "least coverage of a pixel; 0: any");
        field("max_angle", max_angle, {1, 90},
              "degrees between ray and normal, surface seen at a larger one is dropped; 90: none");
        field("masks", masks, "drop what lies outside of the masks");
        field("min_weight", min_weight, {1, 65535}, "views that must have seen a voxel");
        field("clusters", clusters, {0, 1e9}, "largest components to keep; 0: all");
        field("memory", memory, "bytes for the volume, as 8G; empty: a share of what is free");
    }
};

/// The rules of the options; depth_max may be 0. `origin`: of the splats' frame in that of the box.
/// Throws Error(ExitCode::usage).
DepthRules depth_rules(const MeshOptions& options, Vec3d origin = {});

namespace detail {

double median_depth(std::vector<float> depths);  // of those that are there; 0 without any
std::vector<Camera> cameras_of(const std::vector<View>& views);
float depth_max_of(const Focus& focus, spdlog::level::level_enum level);
TsdfOptions volume_options(const MeshOptions& options,
                           const std::vector<View>& views,
                           float depth_max,
                           std::int64_t free_bytes,
                           spdlog::level::level_enum level);
void check_truncation(const Camera& camera, std::vector<float> depths, const TsdfOptions& volume);
void report_fusion(const DepthCounts& counts,
                   const DepthRules& rules,
                   const FusionReport& fusion,
                   spdlog::level::level_enum level);
void warn_if_empty(const DepthCounts& counts, const DepthRules& rules, double median_depth);
void clean_mesh(TriangleMesh& mesh, int clusters, spdlog::level::level_enum level);

/// Depths beyond twice the distance from the nearest camera to what all look at are background.
template <class Device>
float automatic_depth_max(const std::vector<View>& views,
                          const Gaussians<Device>& gaussians,
                          Backbone<Device>& backbone,
                          spdlog::level::level_enum level) {
    const std::vector<Camera> cameras = cameras_of(views);
    std::optional<Focus> focus = find_focus(cameras);
    if (!focus) {
        const auto& rendered = backbone.forward(gaussians, cameras.front(), gaussians.sh_degree,
                                                Channels::color_plane);
        focus = focus_at_depth(cameras, median_depth(to_host(rendered.depth)));
        spdlog::warn(
            "the optical axes are parallel: depths are limited by the median depth of {}; see "
            "--depth-max",
            views.front().name);
    }
    return depth_max_of(*focus, level);
}

}  // namespace detail

/// The mesh that `views` see, by the backbone of `train`. What does not fit into the budget of
/// memory is kept in `spill_folder` meanwhile. What was done is said at `level`; an empty mesh
/// comes with a warning that says why. Throws Error.
template <class Device>
TriangleMesh extract_mesh(const std::vector<View>& views,
                          const Gaussians<Device>& gaussians,
                          const TrainOptions& train,
                          const MeshOptions& options,
                          const std::string& spill_folder,
                          spdlog::level::level_enum level = spdlog::level::info,
                          Vec3d origin = {}) {
    const auto backbone = make_backbone<Device>(train.backbone, train.core);
    DepthRules rules = depth_rules(options, origin);
    if (rules.depth_max == 0)
        rules.depth_max = detail::automatic_depth_max(views, gaussians, *backbone, level);
    const TsdfOptions volume =
        detail::volume_options(options, views, rules.depth_max, free_bytes(Device{}), level);

    std::vector<DepthCounts> counts(views.size());  // views may be asked for twice
    Buffer<float, Device> depth;
    Buffer<std::uint8_t, Device> mask, fates;
    double median = 0;
    bool checked = false;
    const auto source = [&](int i) -> DepthView<Device> {
        const View& view = views[static_cast<std::size_t>(i)];
        DepthCounts& count = counts[static_cast<std::size_t>(i)];
        const auto& rendered =
            backbone->forward(gaussians, view.camera, gaussians.sh_degree, Channels::color_plane);
        const Camera& camera = rendered.camera;  // that of the depths
        copy(options.masks ? view.mask.pixels : std::vector<std::uint8_t>(), mask);
        count = clean_depth(rendered, camera, std::as_const(mask).span(), rules, depth, fates);
        if (!checked && count.kept > 0) {
            detail::check_truncation(camera, to_host(depth), volume);
            checked = true;
        }
        if (count.kept == 0) median = detail::median_depth(to_host(rendered.depth));
        return {camera, std::as_const(depth).span(), rendered.color.span()};
    };
    FusionReport fusion;
    TriangleMesh mesh =
        fuse_views<Device>(static_cast<int>(views.size()), source, volume,
                           static_cast<float>(options.min_weight), spill_folder, fusion);
    DepthCounts total;
    for (const DepthCounts& count : counts) total += count;
    detail::report_fusion(total, rules, fusion, level);
    detail::warn_if_empty(total, rules, median);
    detail::clean_mesh(mesh, options.clusters, level);
    return mesh;
}

}  // namespace tvsgs
