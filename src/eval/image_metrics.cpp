#include "eval/image_metrics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "core/device/parallel.h"
#include "core/error.h"
#include "render/photometric/ssim_math.h"

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

constexpr int kRadius = kSsimRadius;

/// Windowed means of a, b, a^2, b^2 and ab over rows of one channel, with zeros outside.
class WindowMeans {
public:
    enum Mean { of_a, of_b, of_aa, of_bb, of_ab, kMeans };

    explicit WindowMeans(int width) : width_(width) {
        for (auto* rows : {&raw_, &means_})
            for (auto& row : *rows) row.resize(static_cast<std::size_t>(width));
    }

    /// Blurs along the rows [begin, end).
    template <class T>
    void read(const Image<T>& a, const Image<T>& b, int channel, int begin, int end) {
        begin_ = begin, end_ = end;
        for (auto& plane : rows_)
            plane.assign(static_cast<std::size_t>(end - begin) * static_cast<std::size_t>(width_),
                         0);
        for (int y = begin; y < end; ++y) {
            for (int x = 0; x < width_; ++x) {
                const double va = unit(a.at(x, y, channel)), vb = unit(b.at(x, y, channel));
                raw_[of_a][x] = va, raw_[of_b][x] = vb;
                raw_[of_aa][x] = va * va, raw_[of_bb][x] = vb * vb, raw_[of_ab][x] = va * vb;
            }
            for (int mean = 0; mean < kMeans; ++mean) {
                const double* from = raw_[mean].data();
                double* to = row(mean, y);
                for (int k = -kRadius; k <= kRadius; ++k) {
                    const double weight = ssim_weight<double>(k);
                    for (int x = std::max(0, -k); x < std::min(width_, width_ - k); ++x)
                        to[x] += weight * from[x + k];
                }
            }
        }
    }

    /// The means of row y; the rows within kRadius must have been read.
    const std::array<std::vector<double>, kMeans>& at(int y) {
        for (int mean = 0; mean < kMeans; ++mean) {
            double* to = means_[mean].data();
            std::fill_n(to, width_, 0.0);
            for (int v = std::max(begin_, y - kRadius); v <= std::min(end_ - 1, y + kRadius); ++v) {
                const double weight = ssim_weight<double>(v - y);
                const double* from = row(mean, v);
                for (int x = 0; x < width_; ++x) to[x] += weight * from[x];
            }
        }
        return means_;
    }

private:
    double* row(int mean, int y) {
        return rows_[mean].data() + static_cast<std::ptrdiff_t>(y - begin_) * width_;
    }

    int width_, begin_ = 0, end_ = 0;
    std::array<std::vector<double>, kMeans> raw_, rows_, means_;
};

template <class T>
Ssim ssim_of(const Image<T>& a, const Image<T>& b) {
    require_same_shape(a, b);
    constexpr int kRows = 32;  // of a chunk, whose rows fit into the cache
    const int width = a.width, height = a.height;
    struct Sums {
        double all = 0, valid = 0;
    };
    std::vector<Sums> of_rows(static_cast<std::size_t>(height));
    run_ranges(height, kRows, [&](int begin, int end, int /*slot*/) {
        WindowMeans windows(width);
        for (int channel = 0; channel < a.channels; ++channel) {
            windows.read(a, b, channel, std::max(0, begin - kRadius),
                         std::min(height, end + kRadius));
            for (int y = begin; y < end; ++y) {
                const auto& m = windows.at(y);
                Sums& sums = of_rows[static_cast<std::size_t>(y)];
                for (int x = 0; x < width; ++x) {
                    const double value =
                        ssim_terms<double>({m[WindowMeans::of_a][x], m[WindowMeans::of_b][x],
                                            m[WindowMeans::of_aa][x], m[WindowMeans::of_bb][x],
                                            m[WindowMeans::of_ab][x]})
                            .ssim;
                    sums.all += value;
                    if (x >= kRadius && x < width - kRadius && y >= kRadius && y < height - kRadius)
                        sums.valid += value;
                }
            }
        }
    });
    Sums sums;
    for (const Sums& row : of_rows) sums.all += row.all, sums.valid += row.valid;
    const double valid =
        static_cast<double>(std::max(0, width - 2 * kRadius)) * std::max(0, height - 2 * kRadius);
    return {
        sums.all / static_cast<double>(a.pixels.size()),
        valid > 0 ? sums.valid / (valid * a.channels) : std::numeric_limits<double>::quiet_NaN()};
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
