// Photographs as stereo compares them: grey pyramids with the cameras of each size.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/scene.h"
#include "mvs/stereo/mvs_math.h"

namespace tvsgs {

struct StereoLevel {
    Camera camera;
    std::vector<float> grey;  // [0, 1]
};

struct StereoPyramid {
    std::vector<StereoLevel> levels;    // finest first; each half of the one before
    std::vector<std::uint32_t> colors;  // of the finest level, 0xBBGGRR
    std::vector<std::uint8_t> mask;     // of the finest level; empty: none
};

/// Throws Error(ExitCode::input) for fewer than two views or views too small to hold a patch.
void require_views(const std::vector<View>& views);

/// The finest level is the photograph, halved until it is at most 1600 wide or high; the coarsest
/// is at most 400.
std::vector<StereoPyramid> make_pyramids(const std::vector<View>& views);

/// Of all views, one after another.
std::vector<std::uint32_t> packed_colors(const std::vector<StereoPyramid>& pyramids);

/// `view` as seen from a reference camera; its images start at `first_pixel`.
SourceView make_source(const Camera& reference, const Camera& source, int view, int first_pixel);

}  // namespace tvsgs
