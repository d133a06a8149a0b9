// Light and noise of a photograph, which scale the thresholds of texture.
#pragma once

#include "core/scene/image.h"

namespace tvsgs {

/// Measured in about 40,000 pixels. [docs/method/masks.md#dark-and-flat-photographs]
struct PhotoLight {
    /// Range of the grey levels, without the 0.5 % darkest and brightest pixels, over that of a
    /// photograph in full light; 1/64 to 1.
    double share = 1;
    double noise = 0;  // standard deviation, grey levels; at least that of rounding

    /// Factor by which a threshold of texture falls in less light. The threshold in full light is
    /// a standard deviation of `levels` grey levels; `averaged`: noise of the compared values over
    /// that of a pixel. The new threshold is 1.2 deviations of the noise, at least `share` of the
    /// old one, at most the old one. So the factor is exactly 1 in full light.
    double factor(double levels, double averaged) const;
};

/// Estimates the noise from the median absolute deviation of the Laplacian.
PhotoLight measure_light(const ImageU8& photo);

}  // namespace tvsgs
