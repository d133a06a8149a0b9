// Images in host memory, interleaved channels, rows from the top.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace tvsgs {

template <class T>
struct Image {
    int width = 0, height = 0, channels = 0;
    std::vector<T> pixels;  // [height * width * channels]

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

/// Of an RGB image, weights of BT.601.
inline ImageU8 grey_of(const ImageU8& rgb) {
    ImageU8 grey(rgb.width, rgb.height, 1);
    for (std::size_t i = 0; i < grey.pixels.size(); ++i) {
        const std::uint8_t* p = &rgb.pixels[3 * i];
        grey.pixels[i] =
            static_cast<std::uint8_t>((299 * p[0] + 587 * p[1] + 114 * p[2] + 500) / 1000);
    }
    return grey;
}
using ImageF = Image<float>;

}  // namespace tvsgs
