// Depth, order, normals and confidence of our own stereo as the priors that terms ask for.
// [docs/method/vggs.md#priors-of-stereo]
#pragma once

#include <vector>

#include "core/device/device_choice.h"
#include "core/scene/scene.h"
#include "mvs/stereo/patch_match.h"
#include "optim/views/device_view.h"

namespace tvsgs {

// Confidences: measured pixels have more than planes between them, these more than the rest.
inline constexpr float kPlanarConfidence = 0.1f, kFillConfidence = 0.05f;

/// Fills View::maps of the views with those maps of core/scene/prior_maps.h that are `wanted`, of
/// the photographs' size; `stereo` is of the same views. Depth is measured (confidence above
/// kPlanarConfidence), on a plane between measured pixels (that confidence), or filled in
/// (kFillConfidence, without a normal). A view keeps what it came with, depth with its order
/// and confidence, and normals; a view without a measured pixel gets none.
void add_stereo_priors(const std::vector<StereoMaps>& stereo,
                       const MapNames& wanted,
                       std::vector<View>& views);

/// What stereo went by, and what it found; without maps it has not run yet.
struct StereoStart {
    std::vector<Vec3f> points;
    std::vector<StereoMaps> maps;  // of the training views
};

/// add_stereo_priors() of what is `wanted`, where a view came without. Throws
/// Error(ExitCode::input) where there is no stereo to be had.
void make_stereo_priors(const DeviceChoice& device,
                        const StereoOptions& stereo,
                        const MapNames& wanted,
                        StereoStart start,
                        std::vector<View>& views);

}  // namespace tvsgs
