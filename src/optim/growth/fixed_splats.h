// Splats of another training, rendered with the trained ones (init.fixed_splats), so that none grow
// in the surroundings of a block. They take no step, vote or loss, and are not saved.
#pragma once

#include <algorithm>
#include <memory>
#include <utility>

#include "core/scene/gaussians.h"

namespace tvsgs {

/// Copies `splats` with SH coefficients of that degree: drops higher ones, sets missing ones to 0.
inline Gaussians<Cpu> with_sh_degree(const Gaussians<Cpu>& splats, int degree) {
    Gaussians<Cpu> out;
    copy(splats, out);
    out.sh_degree = degree;
    const auto n = std::size_t(splats.size());
    out.sh.resize(n * std::size_t(sh_count(degree)));
    out.sh.fill_zero();
    const int planes = std::min(sh_count(degree), sh_count(splats.sh_degree));
    std::copy_n(splats.sh.data(), n * std::size_t(planes), out.sh.data());
    return out;
}

struct AddNumbersBody {
    const float* from;
    float* to;
    TVSGS_HD void operator()(int i) const { to[i] += from[i]; }
};
void add_numbers(Cpu, int count, const AddNumbersBody& body);
void add_numbers(Cuda, int count, const AddNumbersBody& body);

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
    const Gaussians<Device>& join(const Gaussians<Device>& trained) {
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
                copy_planes(from, n, to, n + extra, 0, array.planes);
                if (changed && !fixed.empty())
                    copy_planes(fixed, extra, to, n + extra, n, array.planes);
            },
            trained, std::as_const(fixed_), joined_);
        return joined_;
    }

    /// Returns zeroed gradients in the shape of join()'s result.
    Gaussians<Device>& clear_gradients() {
        resize(gradients_, joined_.size(), joined_.sh_degree);
        fill_zero(gradients_);
        return gradients_;
    }

    /// Adds the gradients of the trained splats to `dL_dtrained`.
    void add_trained_part(Gaussians<Device>& dL_dtrained) const {
        const int n = dL_dtrained.size(), all = gradients_.size();
        for_each_array(
            [&]<class T>(const SplatArray& array, const Buffer<T, Device>& from,
                         Buffer<T, Device>& to) {
                constexpr int kWidth = sizeof(T) / sizeof(float);
                for (int p = 0; p < array.planes && !to.empty(); ++p)
                    add_numbers(Device{}, n * kWidth,
                                {reinterpret_cast<const float*>(from.data() + std::size_t(p) * all),
                                 reinterpret_cast<float*>(to.data() + std::size_t(p) * n)});
            },
            gradients_, dL_dtrained);
    }

private:
    /// Copies n splats to splat `first` of `all`; SH arrays have a plane per coefficient.
    template <class T>
    static void copy_planes(const Buffer<T, Device>& from,
                            int n,
                            Buffer<T, Device>& to,
                            int all,
                            int first,
                            int planes) {
        for (std::size_t p = 0; p < std::size_t(planes); ++p)
            detail::copy(Device{}, from.data() + p * n, Device{}, to.data() + p * all + first,
                         std::size_t(n) * sizeof(T));
    }

    Gaussians<Device> fixed_, joined_, gradients_;
};

}  // namespace tvsgs
