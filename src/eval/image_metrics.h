// PSNR and SSIM as 3DGS defines them, in double on the host; and LPIPS, the distance between two
// images in the features of a classification network. [Zhang18]
#pragma once

#include <string>
#include <vector>

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

enum class LpipsNet { vgg, alex };

/// A convolution with its ReLU, and the max pooling before it.
struct LpipsLayer {
    int index;  // as in torchvision: features.<index>
    int in, out, kernel, stride, padding;
    int pool;  // edge of the pooling window, with stride 2; 0: none
    bool tap;  // its output is compared
};
const std::vector<LpipsLayer>& lpips_layers(LpipsNet net);

struct LpipsWeights {
    LpipsNet net = LpipsNet::vgg;
    std::vector<std::vector<float>> kernels;  // per layer [out in kernel kernel]
    std::vector<std::vector<float>> biases;   // per layer [out]
    std::vector<std::vector<float>> linear;   // per tap [out], not negative
};

/// Reads a .safetensors or .npz file with features.N.weight and .bias, named as in torchvision (a
/// prefix "net." is allowed), and lin0.model.1.weight (or lin0.weight) to lin4. The first
/// convolution determines the network. Throws Error(ExitCode::input), "E_LPIPS_WEIGHTS", with all
/// missing or wrong tensors.
LpipsWeights read_lpips_weights(const std::string& path);

/// Input of the network for a colour in [0, 1]: the colour itself, as in 3DGS and its descendants,
/// or 2 c - 1, as the authors of LPIPS specify.
enum class LpipsRange { zero_one, minus_one_one };

inline constexpr int kLpipsMinEdge = 32;  // px; four poolings leave 2 px

/// LPIPS of RGB images of one shape with values in [0, 1]; NaN for an edge below kLpipsMinEdge.
double lpips(const ImageF& a, const ImageF& b, const LpipsWeights& weights, LpipsRange range);

}  // namespace tvsgs
