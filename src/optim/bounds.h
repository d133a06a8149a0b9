// Splats stay as small and as round as something that a view could have measured.
// [docs/method/masks.md#bounds]
#pragma once

#include <cmath>

#include "core/camera.h"
#include "core/gaussians.h"
#include "core/options.h"
#include "core/parallel.h"

namespace tvsgs {

struct BoundOptions {
    float max_px = 0, max_ratio = 0;

    template <class Visitor>
    void fields(Visitor& field) {
        field(
            "max_px", max_px, {0, 1e6},
            "largest standard deviation of a splat, in pixels of the view that sees it finest; 0: "
            "any");
        field("max_ratio", max_ratio, {0, 1e6},
              "longest axis of a splat over its second; 0: any, else 1 or more");
    }
    bool on() const { return max_px > 0 || max_ratio > 0; }
};

/// The nearest log scales within the bounds; what is not a number stays one.
///   most    log of the largest standard deviation;   ratio   log of the longest over the second
template <class Real>
TVSGS_HD Vec3<Real> bounded(Vec3<Real> log_scale, Real most, Real ratio) {
    int longest = 0;
    for (int k = 1; k < 3; ++k)
        if (log_scale[k] > log_scale[longest]) longest = k;
    const Real a = log_scale[(longest + 1) % 3], b = log_scale[(longest + 2) % 3],
               second = a > b ? a : b;
    if (log_scale[longest] > second + ratio) log_scale[longest] = second + ratio;
    for (int k = 0; k < 3; ++k)
        if (log_scale[k] > most) log_scale[k] = most;
    return log_scale;
}

struct BoundBody {
    Span<const Camera> cameras;
    BoundOptions bounds;
    Span<const Vec3f> means;
    Span<Vec3f> log_scales;
    const int* halted;  // where *halted (may be null) is not 0, nothing changes

    TVSGS_HD void operator()(int i) const {
        if (halted != nullptr && *halted != 0) return;
        constexpr float kAny = 1e30f;
        const float most = bounds.max_px > 0
                               ? std::log(bounds.max_px * finest_pixel(cameras, means[i]))
                               : kAny,
                    ratio = bounds.max_ratio > 0 ? std::log(bounds.max_ratio) : kAny;
        log_scales[i] = bounded(log_scales[i], most, ratio);
    }
};

}  // namespace tvsgs
