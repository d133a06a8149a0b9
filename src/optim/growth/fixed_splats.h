// Splats of another training that are rendered with the trained ones (init.fixed_splats). They
// explain the surroundings of a block, so that no splats grow there. They take no step, vote or
// loss, do not grow, and are not saved.
#pragma once

#include <algorithm>
#include <memory>

#include "core/scene/gaussians.h"

namespace tvsgs {

/// Copies `splats` with SH coefficients of that degree: drops higher ones, sets missing ones to 0.
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
    /// `fixed`: may be null; `sh_degree`: degree of the trained splats.
    FixedSplats(const std::shared_ptr<const Gaussians<Cpu>>& fixed, int sh_degree) {
        if (fixed) copy(with_sh_degree(*fixed, sh_degree), fixed_);
    }

    bool none() const { return fixed_.size() == 0; }

    /// Returns the trained splats followed by the fixed ones; `trained` itself where none are
    /// fixed. Valid until the next call. The fixed splats' shapes already include their smoothing
    /// filter, so their filter is 0.
    const Gaussians<Device>& join(const Gaussians<Device>& trained);

    /// Returns zeroed gradients in the shape of join()'s result.
    Gaussians<Device>& clear_gradients() {
        resize(gradients_, joined_.size(), joined_.sh_degree);
        fill_zero(gradients_);
        return gradients_;
    }

    /// Adds the gradients of the trained splats to `dL_dtrained`.
    void add_trained_part(Gaussians<Device>& dL_dtrained) const;

private:
    Gaussians<Device> fixed_, joined_, gradients_;
};

}  // namespace tvsgs
