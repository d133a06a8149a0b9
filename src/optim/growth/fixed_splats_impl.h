// Copies between the arrays of FixedSplats; included by one file per device.
#pragma once

#include <utility>

#include "optim/growth/fixed_splats.h"
#include "optim/growth/splat_planes.h"

namespace tvsgs {

template <class Device>
const Gaussians<Device>& FixedSplats<Device>::join(const Gaussians<Device>& trained) {
    if (none()) return trained;
    const int n = trained.size(), extra = fixed_.size();
    const bool changed = joined_.size() != n + extra;
    // resize() leaves empty optional arrays empty.
    for_each_array(
        [](const SplatArray& array, const auto& from, auto& to) {
            if (array.optional && !from.empty() && to.empty()) to.resize(1);
        },
        trained, joined_);
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
