// From a photograph to a network's input, and from its output to a map of the photograph.
#pragma once

#include <vector>

#include "apps/priors/network.h"
#include "apps/priors/recipe.h"
#include "core/image.h"

namespace tvsgs::priors {

/// The input, and the window of it that the photograph fills, in its pixels.
struct InputPlace {
    int width = 0, height = 0;
    int x = 0, y = 0, photo_width = 0, photo_height = 0;
};

/// Of a size that is settled. Throws Error(ExitCode::usage) where it is too large.
InputPlace place_photo(const Recipe& recipe, int photo_width, int photo_height);

/// [3, height, width]: the photograph, resized with Pillow's bicubic filter, beside it the mean
/// colour of ImageNet, all normalised.
std::vector<float> input_of(const Recipe& recipe, const InputPlace& place, const ImageU8& photo);

/// The output as a map over the whole input: one channel of depth, three of normals (unit, in
/// [-1, 1]), any number of features. Throws Error(ExitCode::input), E_ONNX, where it is no such
/// map, saying what was found; `path` is for messages.
ImageF map_of(const Recipe& recipe,
              const InputPlace& place,
              const Tensor& output,
              const std::string& path);

/// The photograph's window of such a map, in the photograph's shape to 1 % or a pixel: as it is
/// where it has that shape, else linear between pixels, and never smaller than the window in both
/// directions. Normals are unit again.
ImageF map_of_photo(const Recipe& recipe,
                    const InputPlace& place,
                    const ImageF& map,
                    int photo_width,
                    int photo_height);

}  // namespace tvsgs::priors
