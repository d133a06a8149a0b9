// Descriptors of photographs without a network: what stands in for learned features.
#pragma once

#include <cstdint>
#include <vector>

#include "core/options.h"
#include "core/scene/scene.h"

namespace tvsgs {

/// orient: directions of edges around a pixel, near and far; wide basins, whatever the exposure.
/// census: differences to points around a pixel; sharper and narrower.
enum class Descriptor { orient, census };

struct DescriptorOptions {
    Descriptor kind = Descriptor::orient;

    template <class Visitor>
    void fields(Visitor& field) {
        field.choice("kind", kind, {"orient32", "census32"},
                     "of photographs, for loss.features where no prior brings features; orient32: "
                     "directions of edges within 1 to 8 px; census32: differences to 32 points "
                     "within 6 px, sharper and narrower");
    }
};

inline constexpr int kDescriptorChannels = 32;

/// Of a photograph [H W 3] at width_px x height_px, as a map [height_px width_px 32] of that name.
/// 0 where there is too little contrast to tell places apart. Lengths are pixels of the map.
/// `roll_rad`: by how much the photograph is turned, from x towards y; the descriptors are not.
ViewMap describe_photo(const ImageU8& photo,
                       Descriptor kind,
                       const std::string& name,
                       int width_px,
                       int height_px,
                       float roll_rad = 0);

/// By how much the image of `camera` is turned against one in which the world's direction `up`
/// points upwards, from x towards y; 0 where the camera looks along it.
float image_roll(const Camera& camera, Vec3f up);

/// Adds the maps `features` and `coarse_features`, a half and a quarter of each photograph's size,
/// to all views; these must not have them. Cameras may be rolled: directions count from what is up
/// in the first view. Returns the bytes that the maps take.
std::int64_t add_descriptors(Descriptor kind, std::vector<View>& views);

}  // namespace tvsgs
