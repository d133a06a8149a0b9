// Mapping from a view's pixels to a prior map of its photograph, and interpolation of the map.
// [docs/guide/priors.md#sizes]
#pragma once

#include <array>
#include <optional>
#include <string>

#include "core/scene/image.h"
#include "core/scene/scene.h"
#include "io/scene/camera_model.h"

namespace tvsgs {

/// A window of the photograph's file: x, y, width and height in the file's pixels.
using PhotoWindow = std::array<double, 4>;

/// The largest centred square, for maps made from a centre crop.
PhotoWindow centre_square(const View& view);

/// Position of a view's pixels in one map.
class MapPlacement {
public:
    /// `camera`: intrinsics of the photograph's file, if the loader removed lens distortion.
    /// Without a `window` the map shows the whole file. Throws Error(ExitCode::input),
    /// E_PRIOR_SIZE, if the aspect ratio of the map differs from the part that it shows. Messages
    /// contain `path`.
    MapPlacement(const std::string& path,
                 const View& view,
                 const std::optional<Intrinsics>& camera,
                 const std::optional<PhotoWindow>& window,
                 const ImageF& map);

    /// Maps a place of the view's photo to the map. Both count from the corner of the first pixel.
    /// Returns false if the place lies outside the map.
    bool find(double x, double y, double& u, double& v) const;

private:
    std::optional<Intrinsics> camera_;  // at the photo's size
    double scale_x_, scale_y_, offset_x_, offset_y_;
    int width_, height_;
};

/// How to interpolate between pixels; `inverse` interpolates 1 / value.
enum class MapBlend { nearest, linear, inverse };

/// The map's values at a place, one per channel. Returns false outside the map or if the pixel at
/// the place has a NaN. Interpolation never uses NaN: if a neighbour has one, only the pixel at the
/// place counts. `inverse`: interpolates 1 / value if all four values are positive.
bool sample_map(const ImageF& map, MapBlend blend, double u, double v, float* values);

/// Resamples the map to the pixels of a view's photo, or to another grid size; NaN where the map
/// has no value.
ImageF resample_map(const ImageF& map,
                    const MapPlacement& placement,
                    const View& view,
                    int width_px,
                    int height_px,
                    MapBlend blend);

}  // namespace tvsgs
