// Makes depth, order, normals and confidence priors from our stereo.
// [docs/method/vggs.md#priors-of-stereo]
#pragma once

#include <vector>

#include "core/device/device_choice.h"
#include "core/scene/prior_maps.h"
#include "core/scene/scene.h"
#include "mvs/stereo/patch_match.h"
#include "optim/photo/sky.h"
#include "optim/views/device_view.h"

namespace tvsgs {

std::size_t measured_pixels(const StereoMaps& completed);

/// Fills the pixels of the views' stereo maps that have no depth, and raises the confidences of
/// measured pixels above kPlanarConfidence. A filled pixel lies on a plane between measured pixels
/// (kPlanarConfidence), or continues their depth without a normal (kFillConfidence).
std::vector<StereoMaps> completed_maps(const std::vector<StereoMaps>& maps,
                                       const std::vector<View>& views);

/// Fills View::maps with the `wanted` maps of core/scene/prior_maps.h, at the size of the
/// photographs, from the views' completed_maps(). Keeps maps that a view already has: depth
/// together with its order and confidence, and normals. A view without a measured pixel gets none.
void add_stereo_priors(const std::vector<StereoMaps>& completed,
                       const MapNames& wanted,
                       std::vector<View>& views);

/// Points that stereo started from, and the maps of stereo; no maps: stereo has not run yet.
struct StereoStart {
    std::vector<Vec3f> points;
    std::vector<StereoMaps> maps{};  // per training view
    bool completed = false;

    void complete(const std::vector<View>& views) {
        if (!completed) maps = completed_maps(maps, views);
        completed = true;
    }
};

/// Calls add_stereo_priors() for the `wanted` maps that views lack. Runs stereo if `start` has no
/// maps. Throws Error(ExitCode::input) where stereo fails.
void make_stereo_priors(const DeviceChoice& device,
                        const StereoOptions& stereo,
                        const MapNames& wanted,
                        StereoStart start,
                        std::vector<View>& views);

/// Fills the gaps of a stereo cloud, so that pictures have no holes. Adds points of confidence 0:
/// one per `spacing_px` x `spacing_px` pixels of the views' completed_maps() that no point covers.
/// A point covers a pixel if it projects to at most one pixel away, and the completed surface lies
/// at most 5 % behind it. A new point has the completed depth and normal and the photograph's
/// colour. A pixel gets no point at a depth edge, or if less than 60 % of the pixels up to 6
/// pixels away are measured. A view without a measured pixel adds nothing. `sky`: its far pixels
/// get no point; no views: unknown. Returns the number of added points.
/// [docs/method/support.md#gaps]
std::size_t add_gap_points(const std::vector<StereoMaps>& completed,
                           const std::vector<View>& views,
                           const SkyDetection& sky,
                           int spacing_px,
                           PointCloud& cloud);

}  // namespace tvsgs
