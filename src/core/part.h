// The contiguous parts into which processes divide what one of them alone has to hold.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/buffer.h"

namespace tvsgs {

/// Elements [begin, end).
struct Part {
    int begin = 0, end = 0;

    TVSGS_HD int size() const { return end - begin; }
    TVSGS_HD bool holds(int i) const { return begin <= i && i < end; }
};

/// The values of a part, by the places that they have in the whole.
template <class T>
struct PartSpan {
    Span<T> values;
    int begin = 0;

    TVSGS_HD T& operator[](int i) const { return values[static_cast<std::size_t>(i - begin)]; }
};

/// A loop's body for the elements from `first` on.
template <class Body>
struct FromBody : Body {
    int first;

    TVSGS_HD void operator()(int i) const { Body::operator()(first + i); }
    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int i, void* scratch) const {
        Body::operator()(warp, first + i, scratch);
    }
};
template <class Body>
FromBody<Body> from(int first, const Body& body) {
    return {body, first};
}

/// Parts begin at multiples of it: what is packed by 32 lies in one.
inline constexpr int kPartGrain = 32;

/// Part `rank` of `ranks` about equal ones of `count` elements, in order; the last ones may be
/// empty. One process has all.
TVSGS_HD inline Part part_of(int count, int rank, int ranks) {
    const std::int64_t grains = (std::int64_t{count} + kPartGrain - 1) / kPartGrain;
    const auto edge = [&](std::int64_t r) {
        const std::int64_t at = grains * r / ranks * kPartGrain;
        return at < count ? static_cast<int>(at) : count;
    };
    return {edge(rank), edge(rank + 1)};
}

/// Where the parts begin, and where the last one ends.
inline std::vector<std::size_t> part_begins(int count, int ranks) {
    std::vector<std::size_t> begins{0};
    for (int r = 0; r < ranks; ++r)
        begins.push_back(static_cast<std::size_t>(part_of(count, r, ranks).end));
    return begins;
}

}  // namespace tvsgs
