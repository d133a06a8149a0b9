// Splats of another training that are drawn with those that train (init.fixed_splats): what lies
// outside of a block is explained, and nothing grows in its place. They take no step, no vote and
// no loss of their own, do not grow, and are not saved; only rendering sees them.
#pragma once

#include <algorithm>
#include <memory>
#include <utility>

#include "core/gaussians.h"
#include "core/parallel.h"

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

/// `splats` with harmonics of that degree: higher ones are left out, missing ones are 0.
inline Gaussians<Cpu> with_sh_degree(const Gaussians<Cpu>& splats, int degree) {
    Gaussians<Cpu> out;
    copy(splats, out);
    out.sh_degree = degree;
    const auto n = static_cast<std::size_t>(splats.size());
    out.sh.resize(n * static_cast<std::size_t>(sh_count(degree)));
    out.sh.fill_zero();
    const int planes = std::min(sh_count(degree), sh_count(splats.sh_degree));
    std::copy_n(splats.sh.data(), n * static_cast<std::size_t>(planes), out.sh.data());
    return out;
}

template <class Device>
class FixedSplats {
public:
    /// `fixed`: null for none; `sh_degree`: of the splats that train.
    FixedSplats(const std::shared_ptr<const Gaussians<Cpu>>& fixed, int sh_degree) {
        if (fixed) copy(with_sh_degree(*fixed, sh_degree), fixed_);
    }

    bool none() const { return fixed_.size() == 0; }

    /// The trained splats and after them these; `trained` itself where there are none. Valid until
    /// the next call. A smoothing filter is part of these splats' shapes already, so theirs is 0.
    const Gaussians<Device>& join(const Gaussians<Device>& trained) {
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

    /// For gradients of what join() gave: in its shape, 0.
    Gaussians<Device>& clear_gradients() {
        resize(gradients_, joined_.size(), joined_.sh_degree);
        fill_zero(gradients_);
        return gradients_;
    }

    /// Adds the trained splats' part of these gradients to `dL_dtrained`.
    void add_trained_part(Gaussians<Device>& dL_dtrained) const {
        const int n = dL_dtrained.size(), all = gradients_.size();
        for_each_array(
            [&](const SplatArray& array, const auto& from, auto& to) {
                if (!to.empty()) over_planes<AddPlaneBody>(from, all, to, n, 0, n, array.planes);
            },
            gradients_, dL_dtrained);
    }

private:
    Gaussians<Device> fixed_, joined_, gradients_;
};

}  // namespace tvsgs
