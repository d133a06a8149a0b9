// The weights of LPIPS from the file that --lpips-weights names.
#pragma once

#include <string>

#include "eval/lpips.h"

namespace tvsgs {

/// A .safetensors or .npz file with features.N.weight and .bias as torchvision names them ("net."
/// before is fine), and lin0.model.1.weight (or lin0.weight) to lin4; the first convolution tells
/// the network. Throws Error(ExitCode::input), "E_LPIPS_WEIGHTS" with all that is missing or wrong.
LpipsWeights read_lpips_weights(const std::string& path);

}  // namespace tvsgs
