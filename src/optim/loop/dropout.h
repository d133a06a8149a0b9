// Leaves groups of neighbouring splats out of an iteration, so that no pixel rests on a few splats.
// [docs/method/pictures.md]
#pragma once

#include "core/device/parallel.h"
#include "core/math/rng.h"
#include "core/scene/gaussians.h"

namespace tvsgs {

/// Splats of a group, neighbours in memory. The first splats lie in the order of their places.
inline constexpr int kDropoutGroup = 11;

/// Whether the group of splat i is left out at `step`.
TVSGS_HD inline bool drops_out(float share, std::uint64_t seed, int step, int i) {
    const Random4 random =
        random4(seed, RandomStream::dropout, std::uint64_t(i / kDropoutGroup), std::uint32_t(step));
    return uniform(random.v[0]) < share;
}

struct DropoutBody {
    static constexpr float kTransparent = -30;  // logit; an opacity of 1e-13

    Span<const float> logits;
    Span<float> left;
    float share;
    std::uint64_t seed;
    int step;

    TVSGS_HD void operator()(int i) const {
        left[i] = drops_out(share, seed, step, i) ? kTransparent : logits[i];
    }
};

/// Makes a share of the groups transparent until it is destroyed.
template <class Device>
class Dropout {
public:
    /// `space` keeps the memory between iterations. Both have to outlive this object.
    Dropout(float share,
            std::uint64_t seed,
            int step,
            Gaussians<Device>& gaussians,
            Buffer<float, Device>& space)
        : logits_(gaussians.opacity_logits), space_(share > 0 ? &space : nullptr) {
        if (!space_) return;
        space.resize(logits_.size());
        parallel_for(Device{}, gaussians.size(),
                     DropoutBody{logits_.span(), space.span(), share, seed, step});
        logits_.swap(space);
    }
    ~Dropout() {
        if (space_) logits_.swap(*space_);
    }
    Dropout(const Dropout&) = delete;
    Dropout& operator=(const Dropout&) = delete;

private:
    Buffer<float, Device>& logits_;
    Buffer<float, Device>* space_;  // null: nothing is left out
};

}  // namespace tvsgs
