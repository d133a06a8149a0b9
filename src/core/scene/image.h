// Images in host memory: interleaved channels, top row first.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <vector>

#include "core/device/device.h"
#include "core/scene/pixel_bytes.h"

namespace tvsgs {

template <class T>
struct Image {
    int width = 0, height = 0, channels = 0;
    /// [height * width * channels]
    std::conditional_t<std::is_same_v<T, std::uint8_t>, PixelBytes, std::vector<T>> pixels;

    Image() = default;
    Image(int w, int h, int c, T value = T{})
        : width(w), height(h), channels(c), pixels(static_cast<std::size_t>(w) * h * c, value) {}

    bool empty() const { return pixels.empty(); }
    T& at(int x, int y, int c = 0) { return pixels[index(x, y, c)]; }
    const T& at(int x, int y, int c = 0) const { return pixels[index(x, y, c)]; }

private:
    std::size_t index(int x, int y, int c) const {
        return (static_cast<std::size_t>(y) * width + x) * channels + c;
    }
};
using ImageU8 = Image<std::uint8_t>;

/// Grey value of a red, green, blue triple, weights of BT.601.
TVSGS_HD inline std::uint8_t grey_of(const std::uint8_t* rgb) {
    return static_cast<std::uint8_t>((299 * rgb[0] + 587 * rgb[1] + 114 * rgb[2] + 500) / 1000);
}

/// Grey version of an RGB image.
inline ImageU8 grey_of(const ImageU8& rgb) {
    ImageU8 grey(rgb.width, rgb.height, 1);
    std::uint8_t* const to = grey.pixels.data();
    for (std::size_t i = 0; i < grey.pixels.size(); ++i) to[i] = grey_of(&rgb.pixels[3 * i]);
    return grey;
}
using ImageF = Image<float>;

}  // namespace tvsgs
