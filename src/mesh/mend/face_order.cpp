#include "mesh/mend/face_order.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>

#include "core/device/morton.h"
#include "core/device/parallel_lists.h"

namespace tvsgs {
namespace {

constexpr int kAxisBits = 10, kDigitBits = 10;
constexpr std::size_t kDigits = std::size_t{1} << kDigitBits;

struct Keyed {
    std::uint32_t key;
    int place;
};

/// Sorts by one digit; the sort is stable.
void sort_digit(const std::vector<Keyed>& from, int shift, std::vector<Keyed>& to) {
    const auto digit = [shift](const Keyed& k) { return (k.key >> shift) & (kDigits - 1); };
    std::vector<std::array<std::uint32_t, kDigits>> counts(kListParts);
    for_parts(from.size(), [&](std::size_t chunk, std::size_t first, std::size_t last) {
        auto& own = counts[chunk];
        own.fill(0);
        for (std::size_t i = first; i < last; ++i) ++own[digit(from[i])];
    });
    std::uint32_t sum = 0;
    for (std::size_t d = 0; d < kDigits; ++d)
        for (auto& own : counts) {
            const std::uint32_t count = own[d];
            own[d] = sum, sum += count;
        }
    for_parts(from.size(), [&](std::size_t chunk, std::size_t first, std::size_t last) {
        auto& own = counts[chunk];
        for (std::size_t i = first; i < last; ++i) to[own[digit(from[i])]++] = from[i];
    });
}

}  // namespace

SpatialOrder spatial_order(const std::vector<Vec3f>& points) {
    constexpr float kFar = std::numeric_limits<float>::infinity();
    std::array<Vec3f, kListParts> lows, highs;
    for_parts(points.size(), [&](std::size_t chunk, std::size_t first, std::size_t last) {
        Vec3f low{kFar, kFar, kFar}, high = -low;
        for (std::size_t i = first; i < last; ++i)
            for (int axis = 0; axis < 3; ++axis) {
                low[axis] = std::min(low[axis], points[i][axis]);
                high[axis] = std::max(high[axis], points[i][axis]);
            }
        lows[chunk] = low, highs[chunk] = high;
    });
    Vec3f low = lows[0];
    float extent = 0;
    for (int axis = 0; axis < 3; ++axis) {
        float high = -kFar;
        for (int c = 0; c < kListParts; ++c) {
            low[axis] = std::min(low[axis], lows[c][axis]);
            high = std::max(high, highs[c][axis]);
        }
        extent = std::max(extent, high - low[axis]);
    }
    constexpr float kCells = 1 << kAxisBits;
    const float scale = extent > 0 ? kCells / extent : 0;
    std::vector<Keyed> keyed(points.size()), other(points.size());
    parallel_for(Cpu{}, static_cast<int>(points.size()), [&](int i) {
        std::uint32_t key = 0;
        for (int axis = 0; axis < 3; ++axis) {
            const float cell = scale * (points[i][axis] - low[axis]);
            const auto bits = static_cast<std::uint64_t>(cell < kCells - 1 ? cell : kCells - 1);
            key |= static_cast<std::uint32_t>(spread_bits(bits)) << axis;
        }
        keyed[i] = {key, i};
    });
    for (int shift = 0; shift < 3 * kAxisBits; shift += kDigitBits) {
        sort_digit(keyed, shift, other);
        keyed.swap(other);
    }
    SpatialOrder order{std::vector<int>(points.size()), std::vector<std::uint32_t>(points.size())};
    parallel_for(Cpu{}, static_cast<int>(points.size()), [&](int i) {
        const auto at = static_cast<std::size_t>(i);
        order.places[at] = keyed[at].place, order.codes[at] = keyed[at].key;
    });
    return order;
}

}  // namespace tvsgs
