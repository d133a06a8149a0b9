// Copies and adds ranges of splat arrays; SH arrays have a plane per coefficient.
#pragma once

#include "core/device/buffer.h"
#include "core/device/parallel.h"
#include "core/math/vec.h"

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

/// Runs Body{from, to} on `n` elements of each plane; `from_count`, `to_count`: elements per plane.
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

}  // namespace tvsgs
