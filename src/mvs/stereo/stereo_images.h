// The work of stereo on the host: grey image pyramids of photographs, with the cameras of each
// size, and the removal of small segments from depth maps.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/scene.h"
#include "mvs/stereo/mvs_math.h"

namespace tvsgs {

/// A grey image with the camera of its size.
struct StereoLevel {
    Camera camera;
    std::vector<float> grey;  // [0, 1]
    float min_variance;       // of a textured patch
};

/// The levels of one view.
struct StereoPyramid {
    std::vector<StereoLevel> levels;    // finest first; each half of the previous
    std::vector<std::uint32_t> colors;  // of the finest level, 0xBBGGRR
    std::vector<std::uint8_t> mask;     // of the finest level; empty: none
};

/// Throws Error(ExitCode::input) for fewer than two views, and for views too small for a patch.
void require_views(const std::vector<View>& views);

/// The finest level is the photograph, halved until it is at most 1600 wide or high. The coarsest
/// level is at most 400.
std::vector<StereoPyramid> make_pyramids(const std::vector<View>& views);

/// Colours of all views, one after another.
std::vector<std::uint32_t> packed_colors(const std::vector<StereoPyramid>& pyramids);

/// Describes `source`, the view number `view`, relative to a reference camera. Its images start at
/// `first_pixel`.
SourceView make_source(const Camera& reference, const Camera& source, int view, int first_pixel);

/// One depth map, modified in place.
struct DepthMapSpan {
    int width, height;
    float* depth;  // [height width], 0 = none
    float* confidence;
};

/// Clears connected segments (8 neighbours, depths within 1 %) of fewer than 100 pixels.
void remove_small_segments(const std::vector<DepthMapSpan>& maps);

}  // namespace tvsgs
