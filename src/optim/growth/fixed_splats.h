// Splats of another training that are drawn with those that train (init.fixed_splats): what lies
// outside of a block is explained, and nothing grows in its place. They take no step, no vote and
// no loss of their own, do not grow, and are not saved; only rendering sees them.
#pragma once

#include <algorithm>
#include <memory>

#include "core/scene/gaussians.h"

namespace tvsgs {

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
    const Gaussians<Device>& join(const Gaussians<Device>& trained);

    /// For gradients of what join() gave: in its shape, 0.
    Gaussians<Device>& clear_gradients() {
        resize(gradients_, joined_.size(), joined_.sh_degree);
        fill_zero(gradients_);
        return gradients_;
    }

    /// Adds the trained splats' part of these gradients to `dL_dtrained`.
    void add_trained_part(Gaussians<Device>& dL_dtrained) const;

private:
    Gaussians<Device> fixed_, joined_, gradients_;
};

}  // namespace tvsgs
