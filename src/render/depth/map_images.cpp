#include "render/depth/map_images.h"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace tvsgs {
namespace {

/// Rounds half up; NaN becomes 0.
std::uint8_t to_8bit(float value) {
    return value > 0 ? std::uint8_t(std::min(value, 1.0f) * 255 + 0.5f) : std::uint8_t{0};
}

template <class Color>
ImageU8 image_of(int width, int height, const Color& color) {
    ImageU8 image(width, height, 3);
    for (std::size_t i = 0; i < image.pixels.size() / 3; ++i) {
        const Vec3f rgb = color(i);
        for (int c = 0; c < 3; ++c) image.pixels[3 * i + c] = to_8bit(rgb[c]);
    }
    return image;
}

/// Colour ramp from dark violet over green to yellow for t in [0, 1], with increasing brightness,
/// so that it also works in grey.
Vec3f ramp(float t) {
    constexpr Vec3f kStops[] = {{0.27f, 0.00f, 0.33f},
                                {0.23f, 0.32f, 0.55f},
                                {0.13f, 0.57f, 0.55f},
                                {0.37f, 0.79f, 0.38f},
                                {0.99f, 0.91f, 0.14f}};
    const float at = t * 4;
    const int i = std::min(int(at), 3);
    return kStops[i] + (at - float(i)) * (kStops[i + 1] - kStops[i]);
}

}  // namespace

ImageU8 color_image(int width, int height, const std::vector<Vec3f>& colors) {
    return image_of(width, height, [&](std::size_t i) { return colors[i]; });
}

ImageU8 normal_image(int width, int height, const std::vector<Vec3f>& normals) {
    return image_of(width, height, [&](std::size_t i) {
        if (!(norm(normals[i]) > 1e-6f)) return Vec3f{};
        // Camera axes are x right, y down, z forward; the image uses y up and z towards the viewer.
        const Vec3f n = normalize(normals[i]);
        return 0.5f * (Vec3f{n.x, -n.y, -n.z} + Vec3f{1, 1, 1});
    });
}

ImageU8 depth_image(int width, int height, const std::vector<float>& depths) {
    const auto is_valid = [](float d) { return d > 0 && std::isfinite(d); };
    std::vector<float> valid;
    std::ranges::copy_if(depths, std::back_inserter(valid), is_valid);
    if (valid.empty()) return ImageU8(width, height, 3);
    const auto percentile = [&](double p) {
        const auto at = valid.begin() + std::ptrdiff_t(p * double(valid.size() - 1));
        std::nth_element(valid.begin(), at, valid.end());
        return *at;
    };
    const float near = percentile(0.01), far = percentile(0.99);
    return image_of(width, height, [&](std::size_t i) {
        if (!is_valid(depths[i])) return Vec3f{};
        const float range = far > near ? far - near : 1;
        return ramp(std::clamp((far - depths[i]) / range, 0.0f, 1.0f));
    });
}

}  // namespace tvsgs
