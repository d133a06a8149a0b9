// Fades splats that are not a measured surface: too large, or without support by stereo.
#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "core/device/parallel.h"
#include "core/math/sigmoid.h"
#include "core/scene/camera.h"
#include "core/scene/gaussians.h"

namespace tvsgs {

/// Far below the logit of kMinAlpha.
inline constexpr float kFaded = -30;

struct FadeLargeBody {
    Span<const Camera> cameras;
    float max_px;
    Span<const Vec3f> means, log_scales;
    Span<float> opacity_logits;

    TVSGS_HD void operator()(int i) const {
        const Vec3f s = exp(log_scales[i]);
        const float most = max_px * finest_pixel(cameras, means[i]);
        if (!(s.x <= most && s.y <= most && s.z <= most)) opacity_logits[i] = kFaded;
    }
};

/// Makes a splat invisible if its largest standard deviation exceeds `max_px` pixels of the camera
/// with the finest one at the splat, preferring cameras whose image contains its mean. Returns the
/// number of faded splats. [docs/method/trust.md#large-splats]
std::size_t fade_large(const std::vector<Camera>& cameras, float max_px, Gaussians<Cpu>& gaussians);
std::size_t fade_large(const std::vector<Camera>& cameras,
                       float max_px,
                       Gaussians<Cuda>& gaussians);

/// Makes the splats that stereo does not support invisible. Returns their number; 0 if no splat has
/// an uncertainty.
template <class Device>
std::size_t fade_unsupported(Gaussians<Device>& g) {
    const std::vector<float> uncertainty = to_host(g.uncertainty);
    std::vector<float> logits = to_host(g.opacity_logits);
    std::size_t faded = 0;
    for (std::size_t i = 0; i < uncertainty.size(); ++i)
        if (!(uncertainty[i] > 0)) logits[i] = kFaded, ++faded;
    if (faded > 0) copy(logits, g.opacity_logits);
    return faded;
}

namespace detail {

template <class Device>
std::size_t fade_large_on(const std::vector<Camera>& cameras, float max_px, Gaussians<Device>& g) {
    Buffer<Camera, Device> at;
    copy(cameras, at);
    parallel_for(Device{}, g.size(),
                 FadeLargeBody{at.span(), max_px, g.means.span(), g.log_scales.span(),
                               g.opacity_logits.span()});
    const std::vector<float> logits = to_host(g.opacity_logits);
    return static_cast<std::size_t>(std::count(logits.begin(), logits.end(), kFaded));
}

}  // namespace detail
}  // namespace tvsgs
