// Single files of priors: maps of numbers as various programs write them.
// [docs/guide/priors.md#how-files-are-understood]
#pragma once

#include <string>

#include "core/scene/image.h"

namespace tvsgs {

/// The order of an array's axes; `automatic`: by which of them has the wanted length.
enum class MapLayout { automatic, hwc, chw };

// Each throws Error(ExitCode::input), E_PRIOR_FILE, that names the file, and takes no memory for
// what a header claims before the file is as long. Rows come from the top, channels interleaved.

/// PFM: "Pf" or "PF", rows from the bottom, of either byte order.
ImageF read_pfm(const std::string& path);

/// ACMM, ACMP, ACMMP: int32 type 1, height, width, channels; float32, interleaved.
ImageF read_dmb(const std::string& path);

/// COLMAP's maps of dense stereo: "width&height&channels&", float32, channel by channel.
ImageF read_colmap_map(const std::string& path);

/// An array of two axes, or of three with `channels` on one of them (0: any number); axes of length
/// 1 are left out. With any number of channels `automatic` is CHW.
ImageF read_npy_map(const std::string& path,
                    int channels = 1,
                    MapLayout layout = MapLayout::automatic);

/// A picture's numbers as in the file. One channel is asked for where three or more are equal, as
/// of a grey picture that was saved in colour; E_PRIOR_FILE where they are not.
ImageF read_picture_map(const std::string& path, int channels = 1);

/// One of these by the file's ending: .pfm, .dmb, .bin, .npy, .png (or .jpg). `channels`: 1 or 3 of
/// depth and normals, 0 of descriptors.
ImageF read_prior_map(const std::string& path,
                      int channels = 1,
                      MapLayout layout = MapLayout::automatic);

}  // namespace tvsgs
