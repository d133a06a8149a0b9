// Keeps splats from becoming needles. Views from the side see axes that the training views, along
// them, see shortened. [docs/method/pictures.md]
#pragma once

#include <cmath>

#include "core/device/parallel.h"
#include "core/scene/gaussians.h"

namespace tvsgs {

struct BoundLongestAxis {
    Span<Vec3f> log_scales;
    float most;  // log of the largest axis over the second largest

    TVSGS_HD void operator()(int i) const {
        Vec3f& s = log_scales[i];
        const int longest = s.x >= s.y ? (s.x >= s.z ? 0 : 2) : (s.y >= s.z ? 1 : 2);
        const float a = s[(longest + 1) % 3], b = s[(longest + 2) % 3],
                    limit = (a > b ? a : b) + most;
        // This comparison keeps NaN.
        if (s[longest] > limit) s[longest] = limit;
    }
};

/// Shortens the largest axis of each splat to `ratio` times the second largest. 0: no limit.
template <class Device>
void bound_longest_axis(float ratio, Gaussians<Device>& gaussians) {
    if (!(ratio > 0)) return;
    parallel_for(Device{}, gaussians.size(),
                 BoundLongestAxis{gaussians.log_scales.span(), std::log(ratio)});
}

}  // namespace tvsgs
