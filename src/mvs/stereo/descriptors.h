// Hand-crafted descriptors of photographs, in place of learned features.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/scene.h"

namespace tvsgs {

inline constexpr int kDescriptorChannels = 32;

/// Describes a photograph [H W 3], resized to width_px x height_px, as a map `name` [height_px
/// width_px 32]: differences of points on four rings to the pixel. 0 where the contrast is too low.
/// `roll_rad`: rotation of the photograph from x towards y, which the descriptors compensate.
ViewMap describe_photo(
    const ImageU8& photo, const std::string& name, int width_px, int height_px, float roll_rad = 0);

/// Rotation of the image of `camera`, from x towards y, against an image in which the world
/// direction `up` points upwards; 0 if the camera looks along `up`.
float image_roll(const Camera& camera, Vec3f up);

/// Adds the maps `features` and `coarse_features`, of a half and a quarter of each photograph's
/// size, to all views, which must not have them. Compensates the roll of the cameras: up is defined
/// by the first view. Returns the bytes of the maps.
std::int64_t add_descriptors(std::vector<View>& views);

}  // namespace tvsgs
