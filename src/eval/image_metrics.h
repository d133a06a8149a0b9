// PSNR and SSIM as 3DGS defines them, in double on the host.
#pragma once

#include "core/scene/image.h"

namespace tvsgs {

/// PSNR from the mean over all pixels and channels; images of one shape, 8-bit or with values in
/// [0, 1]. Infinite for equal images.
template <class T>
double psnr(const Image<T>& a, const Image<T>& b);

/// SSIM with an 11x11 Gaussian window of sigma 1.5 per channel, zeros outside of the image, no
/// sample correction.  [Wang04]
struct Ssim {
    double padded;  // mean over all pixels, as in 3DGS and its descendants
    double valid;   // mean over windows inside; NaN for images below 11 pixels
};
template <class T>
Ssim ssim(const Image<T>& a, const Image<T>& b);

}  // namespace tvsgs
