// CPU version: windows row by row, with packs of neighbouring numbers. Colours are adjacent floats,
// so the same channel of the next pixel is three numbers further.
#include "render/photometric/photometric.h"

#include <algorithm>
#include <vector>

#include "core/device/parallel.h"
#include "core/math/pack.h"

namespace tvsgs {

/// Like detail::magnitude() and detail::sign() for packs.
template <int kBytes>
Pack<float, kBytes> magnitude(Pack<float, kBytes> x) {
    return abs(x);
}
template <int kBytes>
Pack<float, kBytes> sign(Pack<float, kBytes> x) {
    using Lane = Pack<float, kBytes>;
    return select(x > Lane(0), Lane(1), select(x < Lane(0), Lane(-1), Lane(0)));
}

namespace {

constexpr int kReach = 3 * kSsimRadius;  // zeros before and after a row

template <class Lane>
Lane load(const float* from) {
    if constexpr (std::is_same_v<Lane, float>)
        return *from;
    else
        return Lane::load(from);
}
void store(float value, float* to) {
    *to = value;
}
template <int kBytes>
void store(Pack<float, kBytes> value, float* to) {
    value.store(to);
}

/// Calls visit.operator()<Lane>(i) for packs of the numbers of a row, then <float> for the rest.
template <class Lane, class Visit>
void for_packs(int numbers, const Visit& visit) {
    int i = 0;
    for (; i + Lane::kSize <= numbers; i += Lane::kSize) visit.template operator()<Lane>(i);
    for (; i < numbers; ++i) visit.template operator()<float>(i);
}

/// The two passes for one row. `columns`: memory for kMoments vertical window sums of the row, with
/// zeros around them, and for its shares of the loss.
struct PhotometricRow {
    int width, height;
    PhotometricWeights weights;
    float per_value;
    const float *color, *photo;  // [H W 3], as all below
    float *dS_dx, *dS_dxx, *dS_dxy, *dL_dcolor;
    float* pixel_loss;  // [H W]

    int numbers() const { return 3 * width; }
    int stride() const { return kReach + numbers() + kReach; }
    static constexpr int kMoments = 5;

    void narrow_moments(int y, float* columns) const { moments<Pack<float>>(y, columns); }
    void narrow_gradient(int y, float* columns) const { gradient<Pack<float>>(y, columns); }
    TVSGS_WIDE void wide_moments(int y, float* columns) const {
        moments<Pack<float, kWideBytes>>(y, columns);
    }
    TVSGS_WIDE void wide_gradient(int y, float* columns) const {
        gradient<Pack<float, kWideBytes>>(y, columns);
    }

private:
    std::size_t at(int y) const { return std::size_t(y) * std::size_t(numbers()); }

    /// Calls visit(weight, first number) for the rows of y's window. Rows outside the image are 0.
    template <class Visit>
    void window(int y, const Visit& visit) const {
        const int low = std::max(0, y - kSsimRadius), high = std::min(height - 1, y + kSsimRadius);
        for (int j = low; j <= high; ++j) visit(ssim_weight<float>(j - y), at(j));
    }
    /// Horizontal windows of `kCount` sums at number i.
    template <class Lane, int kCount>
    void across(const float* columns, int i, Lane (&sums)[kCount]) const {
        for (int j = -kSsimRadius; j <= kSsimRadius; ++j) {
            const Lane weight = ssim_weight<float>(j);
            for (int k = 0; k < kCount; ++k)
                sums[k] += weight * load<Lane>(columns + k * stride() + kReach + i + 3 * j);
        }
    }

    template <class Pack>
    void moments(int y, float* columns) const {
        for_packs<Pack>(numbers(), [&]<class Lane>(int i) {
            Lane sums[kMoments] = {};
            window(y, [&](float weight, std::size_t row) {
                const Lane w = weight, a = load<Lane>(color + row + i),
                           b = load<Lane>(photo + row + i);
                sums[0] += w * a, sums[1] += w * b;
                sums[2] += w * (a * a), sums[3] += w * (b * b), sums[4] += w * (a * b);
            });
            for (int k = 0; k < kMoments; ++k) store(sums[k], columns + k * stride() + kReach + i);
        });
        float* const shares = columns + kMoments * stride();
        for_packs<Pack>(numbers(), [&]<class Lane>(int i) {
            Lane m[kMoments] = {};
            across(columns, i, m);
            const std::size_t p = at(y) + std::size_t(i);
            const SsimTerms<Lane> t = ssim_terms<Lane>({m[0], m[1], m[2], m[3], m[4]});
            store(detail::loss_share(load<Lane>(color + p), load<Lane>(photo + p), t.ssim, weights,
                                     per_value),
                  shares + i);
            store(t.dS_dx, dS_dx + p), store(t.dS_dxx, dS_dxx + p), store(t.dS_dxy, dS_dxy + p);
        });
        for (int x = 0; x < width; ++x) {
            const float* share = shares + 3 * x;
            pixel_loss[at(y) / 3 + std::size_t(x)] = share[0] + share[1] + share[2];
        }
    }

    template <class Pack>
    void gradient(int y, float* columns) const {
        for_packs<Pack>(numbers(), [&]<class Lane>(int i) {
            Lane sums[3] = {};
            window(y, [&](float weight, std::size_t row) {
                const Lane w = weight;
                sums[0] += w * load<Lane>(dS_dx + row + i);
                sums[1] += w * load<Lane>(dS_dxx + row + i);
                sums[2] += w * load<Lane>(dS_dxy + row + i);
            });
            for (int k = 0; k < 3; ++k) store(sums[k], columns + k * stride() + kReach + i);
        });
        for_packs<Pack>(numbers(), [&]<class Lane>(int i) {
            Lane s[3] = {};
            across(columns, i, s);
            const std::size_t p = at(y) + std::size_t(i);
            const Lane g = detail::loss_derivative(load<Lane>(color + p), load<Lane>(photo + p),
                                                   s[0], s[1], s[2], weights, per_value);
            store(load<Lane>(dL_dcolor + p) + g, dL_dcolor + p);
        });
    }
};

}  // namespace

void photometric_loss(const PhotometricImages& in, PhotometricScratch<Cpu>& scratch) {
    const auto numbers = 3 * std::size_t(in.width);  // of a row
    scratch.resize(in.color.count), scratch.photo.resize(3 * in.color.count);
    const auto floats = [](auto* data) { return &data->x; };
    const PhotometricRow row{in.width,
                             in.height,
                             in.weights,
                             in.per_value(),
                             floats(in.color.data),
                             scratch.photo.data(),
                             floats(scratch.dS_dx.data()),
                             floats(scratch.dS_dxx.data()),
                             floats(scratch.dS_dxy.data()),
                             floats(in.dL_dcolor.data),
                             in.pixel_loss.data};
    const bool wide = has_wide_packs();
    const auto for_rows = [&](const auto& body) {
        parallel_for_heavy(Cpu{}, in.height, [&](int y) {
            std::vector<float> columns(std::size_t((PhotometricRow::kMoments + 1) * row.stride()));
            body(y, columns.data());
        });
    };
    parallel_for_heavy(Cpu{}, in.height, [&](int y) {
        const std::size_t first = std::size_t(y) * numbers;
        for (std::size_t i = first; i < first + numbers; ++i)
            scratch.photo[i] = float(in.photo[i]) / 255;
    });
    for_rows([&](int y, float* columns) {
        wide ? row.wide_moments(y, columns) : row.narrow_moments(y, columns);
    });
    for_rows([&](int y, float* columns) {
        wide ? row.wide_gradient(y, columns) : row.narrow_gradient(y, columns);
    });
}

}  // namespace tvsgs
