// Prepares the points that training starts from.
#pragma once

#include "core/device/device_choice.h"
#include "core/grouped.h"
#include "pipeline/priors/stereo_priors.h"
#include "pipeline/scene/fixed_points.h"
#include "pipeline/scene/mask_use.h"
#include "pipeline/scene/stereo_cloud.h"

namespace tvsgs {

/// Whether stereo replaces the cloud of the scene.
inline bool needs_stereo(const RunOptions& options, const Scene& scene) {
    return options.scene.init_ply.empty() &&
           scene.points.positions.size() < static_cast<std::size_t>(options.train.init.min_points);
}

/// Checks and thins a cloud from a file (scene.init_ply); replaces a cloud that is too small by a
/// stereo cloud, if that has more points. Expects a scene without points outside of object masks
/// (limit_to_object()), and removes such points from the stereo cloud. Compares measured points
/// with the cloud and fills its gaps with them. Returns the stereo maps, from which priors can be
/// made.
inline StereoStart prepare_points(const DeviceChoice& device,
                                  const RunOptions& options,
                                  Scene& scene) {
    const InitOptions& init = options.train.init;
    StereoStart stereo{scene.points.positions, {}};
    const std::vector<Vec3f>& points = stereo.points;
    if (!options.scene.init_ply.empty()) {
        scene.points =
            prepare_cloud(std::move(scene.points), scene.train, init, options.scene.init_ply);
    } else if (needs_stereo(options, scene)) {
        spdlog::debug("{} start points, {} needed (init.min_points): stereo makes more",
                      grouped(scene.points.positions.size()), grouped(init.min_points));
        try {
            StereoResult found = stereo_cloud(device, scene.train, points, stereo_options(options),
                                              stereo_cap(init.max_points));
            stereo.maps = std::move(found.maps);
            limit_to_object(options.train.loss.photometric.masks, scene.train, found.cloud);
            if (found.cloud.positions.size() > scene.points.positions.size())
                scene.points = std::move(found.cloud);
        } catch (const Error& error) {
            if (error.code() != ExitCode::input || scene.points.positions.empty()) throw;
            spdlog::warn("{}; training starts from the {} points of the scene", error.what(),
                         grouped(scene.points.positions.size()));
        }
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
