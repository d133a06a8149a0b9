// Where a view's pixels lie in a map that was made from the photograph's file, and reading it
// there. [docs/guide/priors.md#sizes]
#pragma once

#include <array>
#include <optional>
#include <string>

#include "core/scene/image.h"
#include "core/scene/scene.h"
#include "io/scene/camera_model.h"

namespace tvsgs {

/// A window of the photograph's file: x, y, width and height in its pixels.
using PhotoWindow = std::array<double, 4>;

/// The middle square, as of maps that were made of a centre crop.
PhotoWindow centre_square(const View& view);

class MapPlacement {
public:
    /// `camera`: of the photograph's file, where lens distortion was undone in loading it. Without
    /// a `window` the map shows all of the file. Throws Error(ExitCode::input), E_PRIOR_SIZE, where
    /// the map's shape is not that of what it shows; `path` is for messages.
    MapPlacement(const std::string& path,
                 const View& view,
                 const std::optional<Intrinsics>& camera,
                 const std::optional<PhotoWindow>& window,
                 const ImageF& map);

    /// Where a place of the view's photo lies in the map; both count from the corner of the first
    /// pixel. False: nowhere.
    bool find(double x, double y, double& u, double& v) const;

private:
    std::optional<Intrinsics> camera_;  // at the photo's size
    double scale_x_, scale_y_, offset_x_, offset_y_;
    int width_, height_;
};

/// What is interpolated between pixels.
enum class MapBlend { nearest, linear, inverse };

/// The map's values at a place, one per channel; false where it has none: outside, or where the
/// pixel that holds the place has a NaN. Pixels with NaN are never mixed in: beside one the pixel
/// that holds the place counts alone. `inverse`: 1 / value is mixed where all four are positive.
bool sample_map(const ImageF& map, MapBlend blend, double u, double v, float* values);

/// The map at the pixels of a view's photo, or of a smaller or larger grid; NaN where there is
/// nothing.
ImageF resample_map(const ImageF& map,
                    const MapPlacement& placement,
                    const View& view,
                    int width_px,
                    int height_px,
                    MapBlend blend);

}  // namespace tvsgs
