#include "mvs/stereo/stereo_images.h"

#include <algorithm>
#include <cmath>

#include "core/device/parallel.h"
#include "core/error.h"
#include "core/scene/photo_light.h"

namespace tvsgs {
namespace {

constexpr int kFinestSide = 1600, kCoarsestSide = 400;
constexpr int kLeastSide = 16;  // px; a patch is 11 to 15 wide

/// Means of 2 x 2 pixels. Drops an odd last row or column, which keeps the camera exact.
Camera halved(Camera camera) {
    camera.width_px /= 2, camera.height_px /= 2;
    camera.fx_px /= 2, camera.fy_px /= 2, camera.cx_px /= 2, camera.cy_px /= 2;
    return camera;
}
template <class T, class Mean>
std::vector<T> halved(const std::vector<T>& pixels, int width, int height, const Mean& mean) {
    std::vector<T> out;
    out.reserve(static_cast<std::size_t>(width / 2) * (height / 2));
    for (int y = 0; y + 1 < height; y += 2)
        for (int x = 0; x + 1 < width; x += 2) {
            const T* p = &pixels[static_cast<std::size_t>(y) * width + x];
            out.push_back(mean(p[0], p[1], p[width], p[width + 1]));
        }
    return out;
}

/// Variance of a textured patch after `halvings` of the photograph, which halve its noise.
float min_variance(const PhotoLight& light, int halvings) {
    const double factor = light.factor(kMinDeviation, std::ldexp(1.0, -halvings));
    return kMinVariance * static_cast<float>(factor * factor);
}

StereoLevel halved(const StereoLevel& level, float min_variance) {
    return {halved(level.camera),
            halved(level.grey, level.camera.width_px, level.camera.height_px,
                   [](float a, float b, float c, float d) { return 0.25f * (a + b + c + d); }),
            min_variance};
}

std::uint32_t mean_color(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) {
    std::uint32_t out = 0;
    for (int shift = 0; shift < 24; shift += 8)
        out |= (((a >> shift & 255) + (b >> shift & 255) + (c >> shift & 255) + (d >> shift & 255) +
                 2) /
                4)
               << shift;
    return out;
}

int long_side(const Camera& camera) {
    return std::max(camera.width_px, camera.height_px);
}

StereoPyramid make_pyramid(const View& view) {
    const std::size_t count = static_cast<std::size_t>(view.photo.width) * view.photo.height;
    StereoPyramid out;
    const PhotoLight light = measure_light(view.photo);
    int halvings = 0;
    StereoLevel level{view.camera, std::vector<float>(count), min_variance(light, halvings)};
    out.colors.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
        const std::uint8_t* p = &view.photo.pixels[3 * i];
        level.grey[i] = (0.299f * p[0] + 0.587f * p[1] + 0.114f * p[2]) / 255;
        out.colors[i] = static_cast<std::uint32_t>(p[0] | p[1] << 8 | p[2] << 16);
    }
    out.mask = view.mask.pixels.to_vector();
    while (long_side(level.camera) > kFinestSide) {
        const int w = level.camera.width_px, h = level.camera.height_px;
        out.colors = halved(out.colors, w, h, mean_color);
        if (!out.mask.empty())
            out.mask = halved(out.mask, w, h, [](int a, int b, int c, int d) {
                return static_cast<std::uint8_t>((a + b + c + d + 2) / 4);
            });
        level = halved(level, min_variance(light, ++halvings));
    }
    out.levels.push_back(std::move(level));
    while (long_side(out.levels.back().camera) > kCoarsestSide &&
           std::min(out.levels.back().camera.width_px, out.levels.back().camera.height_px) >=
               2 * kLeastSide)
        out.levels.push_back(halved(out.levels.back(), min_variance(light, ++halvings)));
    return out;
}

constexpr float kSameSurface = 0.01f;     // relative jump of depth
constexpr std::size_t kMinSegment = 100;  // px; wrong depths agree by chance in small segments

void clear_small_segments(const DepthMapSpan& map) {
    const int count = map.width * map.height;
    std::vector<char> visited(static_cast<std::size_t>(count), 0);
    std::vector<int> segment;
    for (int start = 0; start < count; ++start) {
        if (visited[start] != 0 || !(map.depth[start] > 0)) continue;
        segment.assign(1, start);
        visited[start] = 1;
        for (std::size_t next = 0; next < segment.size(); ++next) {
            const int at = segment[next], x = at % map.width, y = at / map.width;
            for (int py = std::max(y - 1, 0); py <= std::min(y + 1, map.height - 1); ++py)
                for (int px = std::max(x - 1, 0); px <= std::min(x + 1, map.width - 1); ++px) {
                    const int other = py * map.width + px;
                    if (visited[other] != 0) continue;
                    if (!(map.depth[other] > 0) || !(std::abs(map.depth[other] - map.depth[at]) <
                                                     kSameSurface * map.depth[at]))
                        continue;
                    visited[other] = 1;
                    segment.push_back(other);
                }
        }
        if (segment.size() < kMinSegment)
            for (const int at : segment) map.depth[at] = map.confidence[at] = 0;
    }
}

}  // namespace

void require_views(const std::vector<View>& views) {
    if (views.size() < 2)
        throw Error(ExitCode::input, "stereo needs at least 2 views, found ", views.size(),
                    "; choose more views or give a cloud");
    for (const View& view : views)
        if (view.camera.width_px < kLeastSide || view.camera.height_px < kLeastSide)
            throw Error(ExitCode::input, view.name, ": ", view.camera.width_px, "x",
                        view.camera.height_px, " pixels: too small for stereo (at least ",
                        kLeastSide, "x", kLeastSide, ")");
}

std::vector<StereoPyramid> make_pyramids(const std::vector<View>& views) {
    std::vector<StereoPyramid> out(views.size());
    parallel_for_heavy(Cpu{}, static_cast<int>(views.size()),
                       [&](int v) { out[v] = make_pyramid(views[v]); });
    return out;
}

std::vector<std::uint32_t> packed_colors(const std::vector<StereoPyramid>& pyramids) {
    std::vector<std::uint32_t> out;
    for (const StereoPyramid& pyramid : pyramids)
        out.insert(out.end(), pyramid.colors.begin(), pyramid.colors.end());
    return out;
}

SourceView make_source(const Camera& reference, const Camera& source, int view, int first_pixel) {
    // In double, because coordinates of a thousand pixels need all digits of a float.
    const auto exact = [](const Rigid3f& T) {
        return Rigid3d{mat_cast<double>(T.R), vec_cast<double>(T.t)};
    };
    const Rigid3d T = exact(source.camera_from_world) * inverse(exact(reference.camera_from_world));
    const Mat3<double> K{
        {{source.fx_px, 0, source.cx_px}, {0, source.fy_px, source.cy_px}, {0, 0, 1}}};
    const double fx = reference.fx_px, fy = reference.fy_px;
    const Mat3<double> K_inverse{
        {{1 / fx, 0, -reference.cx_px / fx}, {0, 1 / fy, -reference.cy_px / fy}, {0, 0, 1}}};
    SourceView out;
    out.camera = source;
    out.view = view;
    out.first_pixel = first_pixel;
    out.source_from_reference = {mat_cast<float>(T.R), vec_cast<float>(T.t)};
    out.pixels_at_infinity = mat_cast<float>(K * T.R * K_inverse);
    out.epipole = vec_cast<float>(K * T.t);
    return out;
}

void remove_small_segments(const std::vector<DepthMapSpan>& maps) {
    parallel_for_heavy(Cpu{}, static_cast<int>(maps.size()),
                       [&](int i) { clear_small_segments(maps[i]); });
}

}  // namespace tvsgs
