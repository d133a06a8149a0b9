// Depth, order, normals and confidence of our own stereo as the priors that terms ask for.
// [docs/method/vggs.md#priors-of-stereo]
#pragma once

#include <vector>

#include "core/device_choice.h"
#include "core/scene.h"
#include "mvs/patch_match.h"
#include "optim/device_view.h"

namespace tvsgs {

struct StereoPriorOptions {
    bool complete = true, planar = true;
    float fill_confidence = 0.05f, planar_confidence = 0.1f, smoothness = 0.05f;

    template <class Visitor>
    void fields(Visitor& field) {
        field("complete", complete,
              "pixels that stereo does not know are filled in, smoothly but for edges of the "
              "photograph");
        field("planar", planar, "planes between measured pixels guide what is filled in");
        field("planar_confidence", planar_confidence, {0.001, 0.5},
              "of such planes; what is measured has more");
        field("fill_confidence", fill_confidence, {0, 0.5},
              "of what is filled in elsewhere; 0: no term uses it");
        field("smoothness", smoothness, {1e-6, 1e3},
              "of what is filled in, against what is measured");
    }
};

/// Fills View::maps of the views with those maps of core/prior_maps.h that are `wanted`, of the
/// photographs' size; `stereo` is of the same views. Depth is measured (confidence above
/// `planar_confidence`), on a plane between measured pixels (that confidence), or filled in
/// (`fill_confidence`, without a normal). A view keeps what it came with, depth with its order
/// and confidence, and normals; a view without a measured pixel gets none.
void add_stereo_priors(const std::vector<StereoMaps>& stereo,
                       const StereoPriorOptions& options,
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
                        const StereoPriorOptions& options,
                        const MapNames& wanted,
                        StereoStart start,
                        std::vector<View>& views);

}  // namespace tvsgs
