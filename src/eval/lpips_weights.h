// Reads the weights of LPIPS from the file of --lpips-weights.
#pragma once

#include <string>

#include "eval/lpips.h"

namespace tvsgs {

/// Reads a .safetensors or .npz file with features.N.weight and .bias, named as in torchvision (a
/// prefix "net." is allowed), and lin0.model.1.weight (or lin0.weight) to lin4. The first
/// convolution determines the network. Throws Error(ExitCode::input), "E_LPIPS_WEIGHTS", with all
/// missing or wrong tensors.
LpipsWeights read_lpips_weights(const std::string& path);

}  // namespace tvsgs
