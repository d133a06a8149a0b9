// Reorders the arrays of splats in memory.
#pragma once

#include "core/device/morton.h"
#include "core/device/parallel.h"
#include "core/scene/gaussians.h"

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

/// values[i] <- values[from[i]] in each plane, or 0 where cleared[i] (`cleared` may be empty).
/// `scratch` receives the old values.
template <class T, class Device>
void gather(Span<const int> from,
            Span<const std::uint8_t> cleared,
            Buffer<T, Device>& values,
            Buffer<T, Device>& scratch,
            int planes = 1) {
    const std::size_t old_count = values.size() / std::size_t(planes);
    scratch.resize(from.count * std::size_t(planes));
    for (std::size_t p = 0; p < std::size_t(planes); ++p)
        parallel_for(Device{}, from.size(),
                     GatherBody<T>{from, cleared, values.data() + p * old_count,
                                   scratch.data() + p * from.count});
    values.swap(scratch);
}

/// Sorts splats in Morton order, so that the splats of a view are contiguous in runs.
template <class Device>
void sort_by_place(Gaussians<Device>& g) {
    Buffer<int, Device> order;
    morton_order(g.means.span(), order);
    for_each_array(
        [&]<class T>(const SplatArray& array, Buffer<T, Device>& values) {
            Buffer<T, Device> scratch;
            if (!values.empty()) gather(order.span(), {}, values, scratch, array.planes);
        },
        g);
}

}  // namespace tvsgs
