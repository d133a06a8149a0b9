// Prepares the points that training starts from.
#pragma once

#include "core/device/device_choice.h"
#include "core/grouped.h"
#include "mvs/stereo/patch_match.h"
#include "pipeline/priors/stereo_priors.h"
#include "pipeline/scene/fixed_points.h"
#include "pipeline/scene/mask_use.h"
#include "pipeline/scene/stereo_cloud.h"
#include "plan/decide.h"
#include "tv/cloud_votes.h"

namespace tvsgs {

/// Whether stereo replaces the cloud of the scene.
inline bool needs_stereo(const RunOptions& options, const Scene& scene) {
    return options.scene.init_ply.empty() &&
           scene.points.positions.size() < std::size_t(options.train.init.min_points);
}

/// Why the training cannot start from the scene's points; empty: it can.
inline std::string start_fault(const RunOptions& options, const Scene& scene) {
    return start_fault(
        look_at_start(scene.train, scene.points.positions, stereo_options(options).use_masks));
}

/// Moves points to the surface that they vote for, and turns their normals.
/// [docs/guide/vote.md#formulas]
inline void refine_by_votes(const DeviceChoice& device, int rounds, PointCloud& cloud) {
    CloudVoteOptions options;
    options.refine = rounds;
    const CloudVotes votes =
        on_device(device, [&](auto tag) { return vote_in_cloud(tag, cloud, options); });
    cloud.positions = votes.positions;
    for (std::size_t i = 0; i < cloud.normals.size(); ++i)
        if (norm(votes.normals[i]) > 0) cloud.normals[i] = votes.normals[i];
}

/// Replaces the scene's points by stereo's, if these are more. Where the training cannot start from
/// the result, replaces it by a coarse cloud, if that has more points. `stereo` gets the maps.
inline void make_points(const DeviceChoice& device,
                        const RunOptions& options,
                        Scene& scene,
                        StereoStart& stereo) {
    const InitOptions& init = options.train.init;
    const StereoOptions by = stereo_options(options);
    const auto replace_by = [&](PointCloud cloud) {
        limit_to_object(options.train.loss.photometric.masks, scene.train, cloud);
        const bool more = cloud.positions.size() > scene.points.positions.size();
        if (more) scene.points = std::move(cloud);
        return more;
    };
    spdlog::debug("{} start points, {} needed (init.min_points): stereo makes more",
                  grouped(scene.points.positions.size()), grouped(init.min_points));
    std::string fault;
    try {
        StereoResult found =
            stereo_cloud(device, scene.train, stereo.points, by, stereo_cap(init.max_points));
        stereo.maps = std::move(found.maps);
        if (init.votes > 0) refine_by_votes(device, init.votes, found.cloud);
        replace_by(std::move(found.cloud));
        fault = start_fault(options, scene);
    } catch (const Error& error) {
        if (error.code() != ExitCode::input) throw;
        fault = error.what();
    }
    if (fault.empty()) return;
    const bool coarse = !start_fault(options, scene).empty() &&
                        replace_by(coarse_cloud(scene.train, stereo.points, by));
    spdlog::warn("{}; training starts from {} {}", fault, grouped(scene.points.positions.size()),
                 coarse ? "rough points (a coarse sweep of the views)" : "points of the scene");
}

/// Checks and thins a cloud from a file (scene.init_ply), or makes start points. Expects a scene
/// without points outside of object masks (limit_to_object()), and removes such points from the
/// stereo cloud. Compares measured points with the cloud and fills its gaps with them. Returns the
/// stereo maps, from which priors can be made.
inline StereoStart prepare_points(const DeviceChoice& device,
                                  const RunOptions& options,
                                  Scene& scene) {
    const InitOptions& init = options.train.init;
    StereoStart stereo{scene.points.positions};
    if (!options.scene.init_ply.empty()) {
        scene.points =
            prepare_cloud(std::move(scene.points), scene.train, init, options.scene.init_ply);
    } else if (needs_stereo(options, scene)) {
        make_points(device, options, scene, stereo);
    }
    if (!scene.fixed_voters.positions.empty()) {
        const std::string& file = options.train.tv.fixed_voters;
        const std::size_t measured = scene.fixed_voters.positions.size();
        std::string agreement;
        if (options.train.tv.fixed_check) {
            const FixedPointsAgreement look = compare_fixed_points(scene);
            check_fixed_points(look, measured, file);
            agreement = fmt::format("; {:.0f} % agree with the start cloud within {:.1f} pixels",
                                    100 * look.agreeing, look.tolerance_px);
        }
        const std::size_t added = fill_with_fixed_points(scene);
        spdlog::info("{}: {} measured points vote{}; {} become splats in gaps of the cloud", file,
                     grouped(measured), agreement, grouped(added));
    }
    return stereo;
}

/// Scales the default near plane, which suits scenes some units deep, to smaller scenes.
inline void fit_near_plane(const Scene& scene, BackboneOptions& render) {
    const float usual = BackboneOptions{}.near, unit = guard_unit(scene);
    if (render.near != usual || unit >= 1) return;
    render.near = usual * unit;
    spdlog::info(
        "The scene is {:.3g} world units deep: sets render.near to {:.3g} instead of {:.3g}", unit,
        render.near, usual);
}

}  // namespace tvsgs
