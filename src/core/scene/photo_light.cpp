#include "core/scene/photo_light.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/math/quantile.h"

namespace tvsgs {
namespace {

constexpr double kFullRange = 100, kLeastShare = 1.0 / 64;  // grey levels; for blank photographs
constexpr double kNoise = 1.2;      // deviations: few patches of noise alone exceed them
constexpr double kRounding = 0.29;  // grey levels: deviation of rounding to 8 bits, sqrt(1 / 12)
// From the median absolute deviation of the Laplacian to the deviation of a pixel's normal noise:
// 0.6745 deviations, and sqrt(4^2 + 4) of the Laplacian's weights.
constexpr double kPerMedian = 1 / (0.6745 * 4.4721);

}  // namespace

double PhotoLight::factor(double levels, double averaged) const {
    return std::clamp(kNoise * noise * averaged / levels, share, 1.0);
}

PhotoLight measure_light(const ImageU8& photo) {
    constexpr double kSample = 40000;  // pixels
    const int step = std::max(
        1, static_cast<int>(std::sqrt(static_cast<double>(photo.width) * photo.height / kSample)));
    const auto grey = [&](int x, int y) {
        return 0.299f * static_cast<float>(photo.at(x, y, 0)) +
               0.587f * static_cast<float>(photo.at(x, y, 1)) +
               0.114f * static_cast<float>(photo.at(x, y, 2));
    };
    std::vector<float> levels, laplacians;
    for (int y = 1 + step / 2; y + 1 < photo.height; y += step)
        for (int x = 1 + step / 2; x + 1 < photo.width; x += step) {
            const float centre = grey(x, y),
                        around = grey(x - 1, y) + grey(x + 1, y) + grey(x, y - 1) + grey(x, y + 1);
            levels.push_back(centre);
            // Clipped pixels have no noise.
            if (centre > 0 && centre < 255) laplacians.push_back(around - 4 * centre);
        }
    const float middle = quantile(laplacians, 0.5);
    for (float& laplacian : laplacians) laplacian = std::abs(laplacian - middle);
    const auto deviation = static_cast<double>(quantile(laplacians, 0.5));
    const auto range = static_cast<double>(quantile(levels, 0.995) - quantile(levels, 0.005));
    return {std::clamp(range / kFullRange, kLeastShare, 1.0),
            std::max(kPerMedian * deviation, kRounding)};
}

}  // namespace tvsgs
