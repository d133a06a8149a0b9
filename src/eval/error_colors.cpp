#include "eval/error_colors.h"

#include <algorithm>
#include <cmath>

namespace tvsgs {
namespace {

/// matplotlib's "hot": black, red, yellow, white.
Vec3f hot(float x) {
    const auto ramp = [x](float from, float to, float low) {
        return std::clamp(low + (1 - low) * (x - from) / (to - from), low, 1.0f);
    };
    return {ramp(0, 0.365079f, 0.0416f), ramp(0.365079f, 0.746032f, 0), ramp(0.746032f, 1, 0)};
}

/// matplotlib's "cividis" at nine places, linear between them.
Vec3f cividis(float x) {
    constexpr Vec3f kStops[] = {
        {0.0f, 0.135f, 0.305f},   {0.105f, 0.227f, 0.440f}, {0.263f, 0.307f, 0.424f},
        {0.373f, 0.392f, 0.434f}, {0.485f, 0.480f, 0.471f}, {0.603f, 0.571f, 0.464f},
        {0.729f, 0.670f, 0.427f}, {0.862f, 0.780f, 0.351f}, {0.996f, 0.909f, 0.218f}};
    const float at = x * 8;
    const int i = std::min(static_cast<int>(at), 7);
    const float t = at - static_cast<float>(i);
    return (1 - t) * kStops[i] + t * kStops[i + 1];
}

}  // namespace

Vec3f error_color(ErrorPalette palette, double error, double full, PointStatus status) {
    if (status == PointStatus::excluded || !std::isfinite(error))
        return palette == ErrorPalette::safe ? Vec3f{0.6f, 0.6f, 0.6f} : Vec3f{0, 0, 1};
    if (status == PointStatus::outlier && palette == ErrorPalette::dtu) return {0, 1, 0};
    if (status == PointStatus::outlier && palette == ErrorPalette::safe) return {0.84f, 0.37f, 0};
    const auto x = static_cast<float>(std::clamp(error / full, 0.0, 1.0));
    switch (palette) {
        case ErrorPalette::dtu:
            return {1, 1 - x, 1 - x};
        case ErrorPalette::tnt:
            return hot(1 - x);
        case ErrorPalette::safe:
            break;
    }
    return cividis(x);
}

}  // namespace tvsgs
