#include "eval/image_metrics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "core/device/parallel.h"
#include "core/error.h"

namespace tvsgs {
namespace {

double unit(std::uint8_t value) {
    return value / 255.0;
}
double unit(float value) {
    return value;
}

template <class T>
void require_same_shape(const Image<T>& a, const Image<T>& b) {
    if (a.empty() || a.width != b.width || a.height != b.height || a.channels != b.channels)
        throw Error(ExitCode::input,
                    str("cannot compare an image of ", a.width, "x", a.height, "x", a.channels,
                        " with one of ", b.width, "x", b.height, "x", b.channels));
}

template <class T>
double psnr_of(const Image<T>& a, const Image<T>& b) {
    require_same_shape(a, b);
    double sum = 0;
    for (std::size_t i = 0; i < a.pixels.size(); ++i) {
        const double difference = unit(a.pixels[i]) - unit(b.pixels[i]);
        sum += difference * difference;
    }
    return -10 * std::log10(sum / static_cast<double>(a.pixels.size()));
}

constexpr int kRadius = 5;
using Plane = std::vector<double>;

/// Separable Gaussian with zeros outside.
Plane blur(const Plane& in, int width, int height) {
    std::array<double, 2 * kRadius + 1> weights;
    double sum = 0;
    for (int k = -kRadius; k <= kRadius; ++k)
        sum += weights[k + kRadius] = std::exp(-k * k / (2 * 1.5 * 1.5));
    for (double& w : weights) w /= sum;
    const auto pass = [&](const Plane& from, Plane& to, int length, int stride, int lines,
                          int line_stride) {
        parallel_for_heavy(Cpu{}, lines, [&](int line) {
            const double* source = from.data() + static_cast<std::ptrdiff_t>(line) * line_stride;
            double* target = to.data() + static_cast<std::ptrdiff_t>(line) * line_stride;
            for (int i = 0; i < length; ++i) {
                double value = 0;
                for (int k = std::max(-kRadius, -i); k <= std::min(kRadius, length - 1 - i); ++k)
                    value +=
                        weights[k + kRadius] * source[static_cast<std::ptrdiff_t>(i + k) * stride];
                target[static_cast<std::ptrdiff_t>(i) * stride] = value;
            }
        });
    };
    Plane rows(in.size()), out(in.size());
    pass(in, rows, width, 1, height, width);
    pass(rows, out, height, width, width, 1);
    return out;
}

template <class T>
Ssim ssim_of(const Image<T>& a, const Image<T>& b) {
    require_same_shape(a, b);
    constexpr double kC1 = 0.01 * 0.01, kC2 = 0.03 * 0.03;
    const int width = a.width, height = a.height;
    const std::size_t pixels = a.pixels.size() / a.channels;
    double sum = 0, valid_sum = 0;
    for (int channel = 0; channel < a.channels; ++channel) {
        Plane pa(pixels), pb(pixels), aa(pixels), bb(pixels), ab(pixels);
        for (std::size_t i = 0; i < pixels; ++i) {
            pa[i] = unit(a.pixels[i * a.channels + channel]),
            pb[i] = unit(b.pixels[i * a.channels + channel]);
            aa[i] = pa[i] * pa[i], bb[i] = pb[i] * pb[i], ab[i] = pa[i] * pb[i];
        }
        for (Plane* plane : {&pa, &pb, &aa, &bb, &ab}) *plane = blur(*plane, width, height);
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x) {
                const std::size_t i = static_cast<std::size_t>(y) * width + x;
                const double ma = pa[i], mb = pb[i];
                const double va = aa[i] - ma * ma, vb = bb[i] - mb * mb, cov = ab[i] - ma * mb;
                const double value = (2 * ma * mb + kC1) * (2 * cov + kC2) /
                                     ((ma * ma + mb * mb + kC1) * (va + vb + kC2));
                sum += value;
                if (x >= kRadius && x < width - kRadius && y >= kRadius && y < height - kRadius)
                    valid_sum += value;
            }
    }
    const double valid =
        static_cast<double>(std::max(0, width - 2 * kRadius)) * std::max(0, height - 2 * kRadius);
    return {
        sum / static_cast<double>(a.pixels.size()),
        valid > 0 ? valid_sum / (valid * a.channels) : std::numeric_limits<double>::quiet_NaN()};
}

}  // namespace

double psnr(const ImageU8& a, const ImageU8& b) {
    return psnr_of(a, b);
}
double psnr(const ImageF& a, const ImageF& b) {
    return psnr_of(a, b);
}
Ssim ssim(const ImageU8& a, const ImageU8& b) {
    return ssim_of(a, b);
}
Ssim ssim(const ImageF& a, const ImageF& b) {
    return ssim_of(a, b);
}

}  // namespace tvsgs
