// Photographs and masks as training wants them: undistorted, at its size.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/scene/pixel_file.h"
#include "core/scene/scene.h"
#include "io/scene/colmap.h"
#include "io/scene/scene_options.h"

namespace tvsgs {

/// What there is to know about a view before its pixels are read.
struct ViewSource {
    const ColmapImage* image = nullptr;
    Intrinsics intrinsics;
    std::string file;
    std::optional<std::string> mask_file;
    bool alpha_on_black = false;
};

/// [H, W, 3] as its camera has it, before lens distortion is undone: turned by its EXIF orientation
/// where it fits only so. `alpha` [H, W, 1] becomes that channel, or empty. Throws
/// Error(ExitCode::input) where the picture cannot be read or has another shape than its camera.
ImageU8 read_photo(const ViewSource& source, ImageU8& alpha, bool& was_turned);

/// In their order; positions count from `origin`. Photographs and masks go into `file`, if there is
/// one, as soon as they are decoded. Throws Error(ExitCode::input) where a picture or
/// mask cannot be read, or has another shape than its camera.
std::vector<View> load_views(const std::vector<ViewSource>& sources,
                             const SceneOptions& options,
                             Vec3d origin,
                             PixelFile* file = nullptr);

/// One line of the log for each camera model that was undistorted, with what it cost.
void say_lenses(const std::vector<ViewSource>& sources);

/// Of `views` as they were loaded from `sources`: a mask without a pixel of the object is rather
/// written in another scale than meant.
void warn_of_empty_masks(const std::vector<ViewSource>& sources, const std::vector<View>& views);

}  // namespace tvsgs
