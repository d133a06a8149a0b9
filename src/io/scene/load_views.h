// Loading of photographs and masks for training: undistorted and resized.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/scene/pixel_file.h"
#include "core/scene/scene.h"
#include "io/scene/colmap.h"
#include "io/scene/scene_options.h"

namespace tvsgs {

/// Description of a view before its pixels are read.
struct ViewSource {
    const ColmapImage* image = nullptr;
    Intrinsics intrinsics;
    std::string file;
    std::optional<std::string> mask_file;
    bool alpha_on_black = false;
};

/// Loads the views in order; positions are relative to `origin`. Turns a photograph by its EXIF
/// orientation if only then its shape fits the camera. Moves each photograph and mask to `file`, if
/// given, right after decoding. Throws Error(ExitCode::input) if an image or mask is
/// unreadable or has another shape than its camera.
std::vector<View> load_views(const std::vector<ViewSource>& sources,
                             const SceneOptions& options,
                             Vec3d origin,
                             PixelFile* file = nullptr);

/// Logs one line per camera model whose distortion was removed, with the lost pixels.
void log_undistortion(const std::vector<ViewSource>& sources);

/// Warns of masks without a single object pixel; their scale is probably wrong. `views` were loaded
/// from `sources`.
void warn_of_empty_masks(const std::vector<ViewSource>& sources, const std::vector<View>& views);

/// Estimates each view's pose error from the observations of its points.
/// [docs/method/cameras.md#residuals] Sets View::pose_error_px of `views`, which were loaded from
/// `sources`. Poses from a bundle adjustment of the same observations have an error near 0: no view
/// improves by moving alone.
void measure_pose_errors(const ColmapPoints& points,
                         const std::vector<ViewSource>& sources,
                         std::vector<View>& views);

}  // namespace tvsgs
