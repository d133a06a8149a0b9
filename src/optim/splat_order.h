// Moving splats to other places in memory.
#pragma once

#include <utility>

#include "core/gaussians.h"
#include "core/morton.h"
#include "core/parallel.h"

namespace tvsgs {

template <class T>
TVSGS_HD T zero() {
    return {};
}
template <>
TVSGS_HD inline Quatf zero<Quatf>() {
    return {0, 0, 0, 0};  // Quatf{} is the identity
}

template <class T>
struct GatherBody {
    Span<const int> from;
    Span<const std::uint8_t> cleared;
    const T* values;
    T* out;

    TVSGS_HD void operator()(int i) const {
        out[i] = !cleared.empty() && cleared[i] ? zero<T>() : values[from[i]];
    }
};

/// values[i] <- values[from[i]] in each of its planes, or 0 where cleared[i] (empty: nowhere).
/// `scratch` gets what was there before.
template <class T, class Device>
void gather(Span<const int> from,
            Span<const std::uint8_t> cleared,
            Buffer<T, Device>& values,
            Buffer<T, Device>& scratch,
            int planes = 1) {
    const std::size_t old_count = values.size() / static_cast<std::size_t>(planes);
    scratch.put(values.memory());
    scratch.resize(from.count * static_cast<std::size_t>(planes));
    for (std::size_t p = 0; p < static_cast<std::size_t>(planes); ++p)
        parallel_for(Device{}, from.size(),
                     GatherBody<T>{from, cleared, values.data() + p * old_count,
                                   scratch.data() + p * from.count});
    values.swap(scratch);
}

/// Where runs of kDealt elements of an order of `count` lie after they have been dealt to kHands in
/// turn, one hand after the other. So any contiguous part of the new order has its share of every
/// neighbourhood, while neighbours in a run stay neighbours.
struct DealtOrder {
    static constexpr int kDealt = 1024, kHands = 32;
    int count;

    /// The old place of the element at `place`.
    TVSGS_HD int operator()(int place) const {
        const int runs = (count + kDealt - 1) / kDealt;
        if (runs == 0) return place;
        const int each = runs / kHands, more = runs % kHands;  // the first ones have one run more
        const auto begin = [&](int hand) { return hand * each + (hand < more ? hand : more); };
        // As if the last run were whole: what lies behind it moves up.
        const int missing = runs * kDealt - count,
                  last_end = begin((runs - 1) % kHands + 1) * kDealt;
        if (place >= last_end - missing) place += missing;
        const int run = place / kDealt, dealt = more * (each + 1);
        const int hand = run < dealt ? run / (each + 1) : more + (run - dealt) / each;
        return ((run - begin(hand)) * kHands + hand) * kDealt + place % kDealt;
    }
};
struct DealBody {
    DealtOrder dealt;
    Span<const int> order;
    Span<int> out;
    TVSGS_HD void operator()(int i) const { out[i] = order[dealt(i)]; }
};

/// Where splats belong in memory: in Morton order, in which those that a view sees lie in runs; or
/// these dealt, so that the parts of several processes all have some of what a view sees.
enum class PlaceOrder { morton, dealt };
inline PlaceOrder place_order(int batch) {
    return batch > 1 ? PlaceOrder::dealt : PlaceOrder::morton;
}
template <class Device>
void order_by_place(Span<const Vec3f> means,
                    PlaceOrder places,
                    Buffer<int, Device>& order,
                    Buffer<int, Device>& scratch) {
    morton_order(means, order);
    if (places == PlaceOrder::morton) return;
    scratch.resize(order.size());
    parallel_for(Device{}, means.size(),
                 DealBody{{means.size()}, std::as_const(order).span(), scratch.span()});
    order.swap(scratch);
}

template <class Device>
void sort_by_place(Gaussians<Device>& g, PlaceOrder places = PlaceOrder::morton) {
    Buffer<int, Device> order, spare;
    order_by_place(g.means.span(), places, order, spare);
    for_each_array(
        [&]<class T>(const SplatArray& array, Buffer<T, Device>& values) {
            Buffer<T, Device> scratch;
            if (!values.empty()) gather(order.span(), {}, values, scratch, array.planes);
        },
        g);
}

}  // namespace tvsgs
