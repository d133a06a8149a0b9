// Reading of single prior maps in the formats of various programs.
// [docs/guide/priors.md#how-files-are-understood]
#pragma once

#include <string>

#include "core/scene/image.h"

namespace tvsgs {

/// Order of an array's axes. automatic: the axis with the expected length holds the channels.
enum class MapLayout { automatic, hwc, chw };

// Each function throws Error(ExitCode::input), E_PRIOR_FILE, that names the file, and compares the
// size in the header with the file before it allocates memory. Rows come from the top, channels
// interleaved.

/// PFM: "Pf" or "PF", rows from the bottom, either byte order.
ImageF read_pfm(const std::string& path);

/// ACMM, ACMP, ACMMP: int32 type 1, height, width, channels; then interleaved float32.
ImageF read_dmb(const std::string& path);

/// COLMAP's dense stereo maps: "width&height&channels&", then float32, channel by channel.
ImageF read_colmap_map(const std::string& path);

/// An array of two axes, or of three axes with `channels` on one of them (0: any number); ignores
/// axes of length 1. If `channels` is 0, `automatic` means CHW.
ImageF read_npy_map(const std::string& path,
                    int channels = 1,
                    MapLayout layout = MapLayout::automatic);

/// The numbers of an image file. With `channels` 1, an image of several equal channels (grey saved
/// as colour) is accepted; unequal channels throw E_PRIOR_FILE.
ImageF read_picture_map(const std::string& path, int channels = 1);

/// Chooses one of the functions above by the extension: .pfm, .dmb, .bin, .npy, .png (or .jpg).
/// `channels`: 1 for depth, 3 for normals, 0 for descriptors.
ImageF read_prior_map(const std::string& path,
                      int channels = 1,
                      MapLayout layout = MapLayout::automatic);

}  // namespace tvsgs
