#include <algorithm>
#include <cmath>

#include "core/device/parallel.h"
#include "core/scene/sky_map.h"
#include "optim/photo/sky.h"

namespace tvsgs {
namespace {

constexpr int kSize = 64;                // texels per side, 3 degrees each
constexpr int kSamples = 200;            // pixels read along a photograph's width, at most
constexpr float kBlur = 0.17f;           // radians, 10 degrees
constexpr float kBlurOfDistance = 0.5f;  // of the angle to the nearest photographed direction

struct Seen {
    Vec3f direction, color;
};

/// Mean colours of the directions that photographs show, by texel.
std::vector<Seen> seen_directions(const std::vector<View>& views) {
    std::vector<Vec3f> directions(kSize * kSize), colors(directions.size());
    std::vector<int> counts(directions.size());
    for (const View& view : views) {
        const int step = std::max(1, view.camera.width_px / kSamples);
        for (int y = 0; y < view.camera.height_px; y += step)
            for (int x = 0; x < view.camera.width_px; x += step) {
                if (!view.mask.empty() && view.mask.at(x, y) == kNoPhoto) continue;
                const Vec3f d = normalize(world_direction(view.camera, x, y));
                const auto at = std::size_t(nearest_texel(d, kSize));
                directions[at] += d, ++counts[at];
                for (int c = 0; c < 3; ++c) colors[at][c] += float(view.photo.at(x, y, c));
            }
    }
    std::vector<Seen> seen;
    for (std::size_t i = 0; i < counts.size(); ++i)
        if (counts[i] > 0) seen.push_back({normalize(directions[i]), colors[i] / float(counts[i])});
    return seen;
}

/// Mean of the colours around a direction, with von Mises-Fisher weights.
Vec3f soft_color(const std::vector<Seen>& seen, Vec3f direction) {
    float nearest = -1;
    for (const Seen& s : seen) nearest = std::max(nearest, dot(direction, s.direction));
    const float distance = std::acos(std::clamp(nearest, -1.0f, 1.0f)),
                blur = std::max(kBlur, kBlurOfDistance * distance);
    Vec3f sum;
    float weights = 0;
    for (const Seen& s : seen) {
        const float w = std::exp((dot(direction, s.direction) - nearest) / (blur * blur));
        sum += w * s.color, weights += w;
    }
    return sum / weights;
}

}  // namespace

ImageU8 make_soft_background(const std::vector<View>& views) {
    const std::vector<Seen> seen = seen_directions(views);
    ImageU8 map(kSize, kSize, 3);
    if (seen.empty()) return map;
    parallel_for_heavy(Cpu{}, kSize * kSize, [&](int i) {
        const Vec2f place = {float(i % kSize) + 0.5f, float(i / kSize) + 0.5f};
        const Vec3f color = soft_color(
            seen, normalize(octahedral_direction(2 / float(kSize) * place - Vec2f{1, 1})));
        for (int c = 0; c < 3; ++c)
            map.pixels[3 * std::size_t(i) + std::size_t(c)] = std::uint8_t(color[c] + 0.5f);
    });
    return map;
}

}  // namespace tvsgs
