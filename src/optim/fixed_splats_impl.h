// The copies of FixedSplats, for the two files that compile them.
#pragma once

#include <utility>

#include "core/parallel.h"
#include "optim/fixed_splats.h"

namespace tvsgs {

template <class T>
struct CopyPlaneBody {
    const T* from;
    T* to;
    TVSGS_HD void operator()(int i) const { to[i] = from[i]; }
};

template <class T>
struct AddPlaneBody {
    const T* from;
    T* to;
    TVSGS_HD void operator()(int i) const { to[i] += from[i]; }
};
template <>
struct AddPlaneBody<Quatf> {
    const Quatf* from;
    Quatf* to;
    TVSGS_HD void operator()(int i) const {
        to[i].w += from[i].w, to[i].x += from[i].x, to[i].y += from[i].y, to[i].z += from[i].z;
    }
};

/// Plane by plane, `n` elements of each: Body{from, to} on planes of `from_count` and `to_count`.
template <template <class> class Body, class T, class Device>
void over_planes(const Buffer<T, Device>& from,
                 int from_count,
                 Buffer<T, Device>& to,
                 int to_count,
                 int to_first,
                 int n,
                 int planes) {
    for (int p = 0; p < planes; ++p)
        parallel_for(Device{}, n,
                     Body<T>{from.data() + static_cast<std::ptrdiff_t>(p) * from_count,
                             to.data() + static_cast<std::ptrdiff_t>(p) * to_count + to_first});
}

template <class Device>
const Gaussians<Device>& FixedSplats<Device>::join(const Gaussians<Device>& trained) {
    if (none()) return trained;
    const int n = trained.size(), extra = fixed_.size();
    const bool changed = joined_.size() != n + extra;
    // Optional arrays that are empty stay so.
    if (!trained.filter.empty() && joined_.filter.empty()) joined_.filter.resize(1);
    resize(joined_, n + extra, trained.sh_degree);
    for_each_array(
        [&](const SplatArray& array, const auto& from, const auto& fixed, auto& to) {
            if (from.empty()) return;
            if (changed && fixed.empty()) to.fill_zero();
            over_planes<CopyPlaneBody>(from, n, to, n + extra, 0, n, array.planes);
            if (changed && !fixed.empty())
                over_planes<CopyPlaneBody>(fixed, extra, to, n + extra, n, extra, array.planes);
        },
        trained, std::as_const(fixed_), joined_);
    return joined_;
}

template <class Device>
void FixedSplats<Device>::add_trained_part(Gaussians<Device>& dL_dtrained) const {
    const int n = dL_dtrained.size(), all = gradients_.size();
    for_each_array(
        [&](const SplatArray& array, const auto& from, auto& to) {
            if (!to.empty()) over_planes<AddPlaneBody>(from, all, to, n, 0, n, array.planes);
        },
        gradients_, dL_dtrained);
}

}  // namespace tvsgs
