// Photometric loss: L1 + SSIM of a render against a photograph.  [Kerbl23, Eq. 7]
#pragma once

#include "core/device/buffer.h"
#include "core/math/vec.h"
#include "render/photometric/ssim_math.h"

namespace tvsgs {

/// Weights of the two parts of the loss.
struct PhotometricWeights {
    float l1, ssim;  // L = l1 * mean |x - y| + ssim * (1 - SSIM); means over pixels and channels
};

/// Scratch memory, kept between calls.
template <class Device>
struct PhotometricScratch {
    Buffer<Vec3f, Device> dS_dx, dS_dxx, dS_dxy;  // [H W] derivatives by the windowed moments
    Buffer<float, Device> photo;                  // [H W 3] 0 to 1; CPU only

    void resize(std::size_t pixels) {
        dS_dx.resize(pixels), dS_dxx.resize(pixels), dS_dxy.resize(pixels);
    }
};

/// A render and its photograph, with the results. [H W] each.
struct PhotometricImages {
    Span<const Vec3f> color;         // rendered, not clamped
    Span<const std::uint8_t> photo;  // [H W 3] 0 to 255
    int width, height;
    PhotometricWeights weights;
    Span<Vec3f> dL_dcolor;   // gets dL/dcolor added
    Span<float> pixel_loss;  // overwritten: each pixel's share of L; their sum is L

    float per_value() const { return 1.0f / (3.0f * float(width) * float(height)); }
};
void photometric_loss(const PhotometricImages& in, PhotometricScratch<Cpu>& scratch);
void photometric_loss(const PhotometricImages& in, PhotometricScratch<Cuda>& scratch);

namespace detail {

TVSGS_HD inline Vec3f photo_pixel(const std::uint8_t* photo, std::size_t at) {
    return {float(photo[3 * at]) / 255, float(photo[3 * at + 1]) / 255,
            float(photo[3 * at + 2]) / 255};
}

TVSGS_HD inline float magnitude(float x) {
    return x < 0 ? -x : x;
}
TVSGS_HD inline float sign(float x) {
    return x > 0 ? 1.0f : x < 0 ? -1.0f : 0.0f;
}

/// Share of the loss of one number: x of the render, y of the photograph.
template <class Real>
TVSGS_HD Real loss_share(Real x, Real y, Real ssim, PhotometricWeights weights, float per_value) {
    return per_value * (weights.l1 * magnitude(x - y) + weights.ssim * (1 - ssim));
}

/// dL/dx of one number from the windowed sums of derivatives.
template <class Real>
TVSGS_HD Real loss_derivative(Real x,
                              Real y,
                              Real dS_dx,
                              Real dS_dxx,
                              Real dS_dxy,
                              PhotometricWeights weights,
                              float per_value) {
    return per_value *
           (weights.l1 * sign(x - y) - weights.ssim * (dS_dx + 2 * x * dS_dxx + y * dS_dxy));
}

}  // namespace detail
}  // namespace tvsgs
