// Makes an initial cloud from views by stereo; shared by tvsgs-init and tvsgs-train.
#pragma once

#include <algorithm>

#include "core/device/device_choice.h"
#include "core/grouped.h"
#include "core/log.h"
#include "core/progress.h"
#include "core/scene/scene.h"
#include "io/files/read_file.h"
#include "mvs/stereo/patch_match.h"
#include "optim/growth/init_cloud.h"

namespace tvsgs {

inline constexpr std::size_t kFewStereoPoints = 2000;  // fewer points hardly show a surface

/// Converts an option whose 0 means no limit.
inline std::size_t stereo_cap(std::int64_t max_points) {
    return max_points > 0 ? std::size_t(max_points) : std::size_t{1} << 40;
}

/// Runs reconstruct_stereo() on the device. Throws Error(ExitCode::usage) if it requires more views
/// to confirm a depth than there are.
inline StereoResult run_stereo(const DeviceChoice& device,
                               const std::vector<View>& views,
                               const std::vector<Vec3f>& points,
                               const StereoOptions& options) {
    if (options.min_consistent > 0 && options.min_consistent >= int(views.size()))
        throw Error(ExitCode::usage, "stereo.min_consistent = ", options.min_consistent, ": with ",
                    views.size(), " views a depth has only ", views.size() - 1,
                    " other views to confirm it; give at most that, or 0");
    return on_device(device,
                     [&](auto tag) { return reconstruct_stereo(tag, views, points, options); });
}

/// Runs stereo, and reduces its cloud to one point per two pixels (inside masks, if used), at most
/// `max_points`, without outliers.
inline StereoResult stereo_cloud(const DeviceChoice& device,
                                 const std::vector<View>& views,
                                 const std::vector<Vec3f>& points,
                                 const StereoOptions& options,
                                 std::size_t max_points) {
    const double start = steady_seconds();
    StereoResult result = run_stereo(device, views, points, options);
    const double stereo_seconds = steady_seconds() - start;
    const std::size_t found = result.cloud.positions.size();
    std::size_t pixels = 0;
    for (std::size_t v = 0; v < views.size(); ++v) {
        const auto& mask = views[v].mask.pixels;
        pixels +=
            options.use_masks && !mask.empty()
                ? std::size_t(std::ranges::count_if(mask, [](int m) { return m >= kObjectMask; }))
                : result.maps[v].depth.size();
    }
    const std::size_t most = std::min(max_points, pixels / 2);
    result.cloud = thin_to_count(result.cloud, most);
    result.cloud = remove_outliers(result.cloud);
    spdlog::info(
        "Stereo of {} views: {} points in {:.2f} s; {} after thinning and outlier removal, {:.2f} "
        "s",
        views.size(), grouped(found), stereo_seconds, grouped(result.cloud.positions.size()),
        steady_seconds() - start - stereo_seconds);
    if (result.cloud.positions.empty())
        throw input_error("stereo found no surface in ", views.size(),
                          " views; they need overlap, texture, and depths within "
                          "stereo.depth_near and stereo.depth_far");
    if (result.cloud.positions.size() < kFewStereoPoints && most >= kFewStereoPoints)
        spdlog::warn(
            "Stereo found only {} points: little overlap or texture, or a wrong range of depths "
            "(stereo.depth_near, stereo.depth_far)",
            grouped(result.cloud.positions.size()));
    return result;
}

}  // namespace tvsgs
