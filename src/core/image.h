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
using ImageF = Image<float>;

}  // namespace tvsgs
