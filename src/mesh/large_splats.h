// Splats too large to be measured surface are not meshed.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "core/camera.h"
#include "core/gaussians.h"
#include "core/parallel.h"

namespace tvsgs {

/// How wide a camera's pixels are at a place.
struct PixelAtDistance {
    Vec3f centre;
    float per_unit;  // width over distance
};

/// Below any render.cull_alpha.
inline constexpr float kFaded = -30;

struct FadeLargeBody {
    Span<const PixelAtDistance> cameras;
    float max_px;
    Span<const Vec3f> means, log_scales;
    Span<float> opacity_logits;

    TVSGS_HD void operator()(int i) const {
        float pixel = std::numeric_limits<float>::max();
        for (int v = 0; v < cameras.size(); ++v) {
            const float width = norm(means[i] - cameras[v].centre) * cameras[v].per_unit;
            pixel = width < pixel ? width : pixel;
        }
        const Vec3f s = exp(log_scales[i]);
        const float most = max_px * pixel;
        if (!(s.x <= most && s.y <= most && s.z <= most)) opacity_logits[i] = kFaded;
    }
};

/// Makes splats invisible whose largest standard deviation is above `max_px` pixels of the camera
/// whose pixels are the finest there. Where no measured point was, splats that grow over the gap
/// show the right colour at any depth. [docs/method/trust.md#large-splats]
void fade_large(const std::vector<Camera>& cameras, float max_px, Gaussians<Cpu>& gaussians);
void fade_large(const std::vector<Camera>& cameras, float max_px, Gaussians<Cuda>& gaussians);

namespace detail {

template <class Device>
void fade_large_on(const std::vector<Camera>& cameras, float max_px, Gaussians<Device>& g) {
    std::vector<PixelAtDistance> pixels;
    for (const Camera& camera : cameras)
        pixels.push_back({camera_centre(camera), 1 / std::max(camera.fx_px, camera.fy_px)});
    Buffer<PixelAtDistance, Device> at;
    copy(pixels, at);
    parallel_for(Device{}, g.size(),
                 FadeLargeBody{std::as_const(at).span(), max_px, std::as_const(g.means).span(),
                               std::as_const(g.log_scales).span(), g.opacity_logits.span()});
}

}  // namespace detail
}  // namespace tvsgs
