#include "eval/image_metrics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "core/device/parallel.h"
#include "core/error.h"
#include "io/files/read_file.h"
#include "render/photometric/ssim_math.h"

namespace tvsgs {
namespace {

/// In [0, 1].
template <class T>
double unit(T value) {
    return std::is_same_v<T, float> ? double(value) : value / 255.0;
}

template <class T>
void require_same_shape(const Image<T>& a, const Image<T>& b) {
    if (a.empty() || a.width != b.width || a.height != b.height || a.channels != b.channels)
        throw input_error("cannot compare an image of ", a.width, "x", a.height, "x", a.channels,
                          " with one of ", b.width, "x", b.height, "x", b.channels);
}

constexpr int kRadius = kSsimRadius, kTaps = 2 * kRadius + 1;

/// out[x] = sum over the taps of weight * rows[tap][x].
void blur(const std::array<const double*, kTaps>& rows, int width, double* __restrict out) {
    for (int x = 0; x < width; ++x) {
        double sum = 0;
        for (int tap = 0; tap < kTaps; ++tap)
            sum += ssim_weight<double>(tap - kRadius) * rows[tap][x];
        out[x] = sum;
    }
}

/// Windowed means of a, b, a^2, b^2 and ab over rows of one channel, with zeros outside.
class WindowMeans {
public:
    enum Mean { of_a, of_b, of_aa, of_bb, of_ab, kMeans };

    explicit WindowMeans(int width) : width_(width), zeros_(width) {
        for (auto& row : raw_) row.resize(width + 2 * kRadius);
        for (auto& row : means_) row.resize(width);
    }

    /// Blurs along the rows [begin, end).
    template <class T>
    void read(const Image<T>& a, const Image<T>& b, int channel, int begin, int end) {
        begin_ = begin, end_ = end;
        for (auto& plane : rows_) plane.resize(std::size_t(end - begin) * width_);
        for (int y = begin; y < end; ++y) {
            for (int x = 0; x < width_; ++x) {
                const double va = unit(a.at(x, y, channel)), vb = unit(b.at(x, y, channel));
                const int at = x + kRadius;
                raw_[of_a][at] = va, raw_[of_b][at] = vb;
                raw_[of_aa][at] = va * va, raw_[of_bb][at] = vb * vb, raw_[of_ab][at] = va * vb;
            }
            for (int mean = 0; mean < kMeans; ++mean) {
                std::array<const double*, kTaps> shifted;
                for (std::size_t tap = 0; tap < kTaps; ++tap) shifted[tap] = &raw_[mean][tap];
                blur(shifted, width_, row(mean, y));
            }
        }
    }

    /// The means of row y; the rows within kRadius must have been read.
    const std::array<std::vector<double>, kMeans>& at(int y) {
        for (int mean = 0; mean < kMeans; ++mean) {
            std::array<const double*, kTaps> around;
            for (int tap = 0, v = y - kRadius; tap < kTaps; ++tap, ++v)
                around[tap] = v >= begin_ && v < end_ ? row(mean, v) : zeros_.data();
            blur(around, width_, means_[mean].data());
        }
        return means_;
    }

private:
    double* row(int mean, int y) {
        return rows_[mean].data() + static_cast<std::ptrdiff_t>(y - begin_) * width_;
    }

    int width_, begin_ = 0, end_ = 0;
    std::vector<double> zeros_;
    std::array<std::vector<double>, kMeans> raw_, rows_, means_;  // raw_ with zeros at both ends
};

}  // namespace

template <class T>
double psnr(const Image<T>& a, const Image<T>& b) {
    require_same_shape(a, b);
    double sum = 0;
    for (std::size_t i = 0; i < a.pixels.size(); ++i) {
        const double difference = unit(a.pixels[i]) - unit(b.pixels[i]);
        sum += difference * difference;
    }
    return -10 * std::log10(sum / static_cast<double>(a.pixels.size()));
}

template <class T>
Ssim ssim(const Image<T>& a, const Image<T>& b) {
    require_same_shape(a, b);
    constexpr int kRows = 32;  // of a chunk, whose rows fit into the cache
    const int width = a.width, height = a.height;
    struct Sums {
        double all = 0, valid = 0;
    };
    std::vector<Sums> of_rows(height);
    run_ranges(height, kRows, [&](int begin, int end, int /*slot*/) {
        WindowMeans windows(width);
        for (int channel = 0; channel < a.channels; ++channel) {
            windows.read(a, b, channel, std::max(0, begin - kRadius),
                         std::min(height, end + kRadius));
            for (int y = begin; y < end; ++y) {
                const auto& m = windows.at(y);
                Sums& sums = of_rows[y];
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
    return {sums.all / static_cast<double>(a.pixels.size()),
            valid > 0 ? sums.valid / (valid * a.channels) : std::nan("")};
}

template double psnr(const ImageU8&, const ImageU8&);
template double psnr(const ImageF&, const ImageF&);
template Ssim ssim(const ImageU8&, const ImageU8&);
template Ssim ssim(const ImageF&, const ImageF&);

}  // namespace tvsgs
