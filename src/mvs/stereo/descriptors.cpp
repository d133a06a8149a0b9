#include "mvs/stereo/descriptors.h"

#include <algorithm>
#include <cmath>

#include "core/device/parallel.h"
#include "core/math/vec.h"
#include "core/scene/prior_maps.h"

namespace tvsgs {
namespace {

constexpr float kLeastContrast = 0.01f;  // of grey values in [0, 1]
constexpr int kRings = 4;
constexpr float kPi = 3.14159265358979f;

/// Repeats the border.
float pixel(const ImageF& image, int x, int y) {
    return image.at(std::clamp(x, 0, image.width - 1), std::clamp(y, 0, image.height - 1));
}

/// Interpolates between pixel centres, which have integer coordinates here.
float between(const ImageF& image, float x, float y) {
    const float left = std::floor(x), top = std::floor(y), u = x - left, v = y - top;
    const int x0 = static_cast<int>(left), y0 = static_cast<int>(top);
    return (1 - v) * ((1 - u) * pixel(image, x0, y0) + u * pixel(image, x0 + 1, y0)) +
           v * ((1 - u) * pixel(image, x0, y0 + 1) + u * pixel(image, x0 + 1, y0 + 1));
}

/// Shrinks the grey photograph to half its size (rounded up) or smaller; means of 2 x 2 pixels if
/// the size is even.
ImageF shrunk(const ImageF& image, int width, int height) {
    ImageF out(width, height, 1);
    const float sx = static_cast<float>(image.width) / static_cast<float>(width),
                sy = static_cast<float>(image.height) / static_cast<float>(height);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            out.at(x, y) = between(image, sx * (static_cast<float>(x) + 0.5f) - 0.5f,
                                   sy * (static_cast<float>(y) + 0.5f) - 0.5f);
    return out;
}

ImageF grey_at(const ImageU8& photo, int width, int height) {
    ImageF grey(photo.width, photo.height, 1);
    for (std::size_t i = 0; i < grey.pixels.size(); ++i) {
        const std::uint8_t* p = &photo.pixels[3 * i];
        grey.pixels[i] = (0.299f * static_cast<float>(p[0]) + 0.587f * static_cast<float>(p[1]) +
                          0.114f * static_cast<float>(p[2])) /
                         255;
    }
    while (grey.width > width || grey.height > height)
        grey = shrunk(grey, std::max(width, (grey.width + 1) / 2),
                      std::max(height, (grey.height + 1) / 2));
    return grey;
}

/// Convolves with a Gaussian of standard deviation `sigma`, px.
ImageF blurred(const ImageF& image, float sigma) {
    const int reach = static_cast<int>(std::ceil(3 * sigma));
    std::vector<float> weights;
    float sum = 0;
    for (int i = -reach; i <= reach; ++i) {
        const float t = static_cast<float>(i) / sigma;
        weights.push_back(std::exp(-0.5f * t * t));
        sum += weights.back();
    }
    const auto along = [&](const ImageF& from, int step_x, int step_y) {
        ImageF out(from.width, from.height, 1);
        for (int y = 0; y < from.height; ++y)
            for (int x = 0; x < from.width; ++x) {
                float value = 0;
                for (int i = -reach; i <= reach; ++i)
                    value += weights[i + reach] * pixel(from, x + i * step_x, y + i * step_y);
                out.at(x, y) = value / sum;
            }
        return out;
    };
    return along(along(image, 1, 0), 0, 1);
}

}  // namespace

ViewMap describe_photo(
    const ImageU8& photo, const std::string& name, int width_px, int height_px, float roll_rad) {
    ViewMap map{name, width_px, height_px, kDescriptorChannels, {}};
    map.values.resize(static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px) *
                      kDescriptorChannels);
    const ImageF smooth = blurred(grey_at(photo, width_px, height_px), 0.7f);
    std::vector<Vec2f> offsets;
    for (int ring = 0; ring < kRings; ++ring)
        for (int k = 0; k < kDescriptorChannels / kRings; ++k) {
            const float radius = 1.5f * static_cast<float>(ring + 1),
                        angle =
                            roll_rad + kPi / 4 * (static_cast<float>(k) + (ring % 2 ? 0.5f : 0.0f));
            offsets.push_back({radius * std::cos(angle), radius * std::sin(angle)});
        }
    float* descriptor = map.values.data();
    for (int y = 0; y < height_px; ++y)
        for (int x = 0; x < width_px; ++x, descriptor += kDescriptorChannels) {
            float squares = 0;
            for (std::size_t i = 0; i < offsets.size(); ++i) {
                const float difference = between(smooth, static_cast<float>(x) + offsets[i].x,
                                                 static_cast<float>(y) + offsets[i].y) -
                                         smooth.at(x, y);
                squares += difference * difference;
                descriptor[i] = std::tanh(difference / 0.02f);
            }
            if (!(squares >= kLeastContrast * kLeastContrast))
                std::fill_n(descriptor, kDescriptorChannels, 0.0f);
        }
    return map;
}

float image_roll(const Camera& camera, Vec3f up) {
    const Vec3f there = camera.camera_from_world.R * up;
    constexpr float kLeast = 0.1f;  // nearer to the axis the direction in the image is unreliable
    if (!(there.x * there.x + there.y * there.y > kLeast * kLeast)) return 0;
    return std::atan2(there.x, -there.y);
}

std::int64_t add_descriptors(std::vector<View>& views) {
    if (views.empty()) return 0;
    const Vec3f up = transpose_times(views[0].camera.camera_from_world.R, {0, -1, 0});
    parallel_for_heavy(Cpu{}, static_cast<int>(views.size()), [&](int v) {
        View& view = views[v];
        const auto add = [&](std::string_view name, int divisor) {
            view.maps.push_back(describe_photo(
                view.photo, std::string(name), (view.photo.width + divisor - 1) / divisor,
                (view.photo.height + divisor - 1) / divisor, image_roll(view.camera, up)));
        };
        add(prior_map::kFeatures, 2);
        add(prior_map::kCoarseFeatures, 4);
    });
    std::int64_t bytes = 0;
    for (const View& view : views)
        for (const ViewMap& map : view.maps)
            if (map.name == prior_map::kFeatures || map.name == prior_map::kCoarseFeatures)
                bytes += static_cast<std::int64_t>(map.values.size() * sizeof(float));
    return bytes;
}

}  // namespace tvsgs
