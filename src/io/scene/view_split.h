// Choice of training and test views.  [docs/guide/input.md#training-and-test-views]
#pragma once

#include <string>
#include <vector>

#include "io/scene/scene_options.h"

namespace tvsgs {

/// Training and test views.
struct ViewSplit {
    std::vector<int> train, test;  // indices into the names, ascending, no index in both
};

/// `names`: all images of the model, sorted. `exists`: which of them are on disk. `own_train` and
/// `own_test`: the scene's own split by name, used if the user gave no list, also with --eval.
/// Skips missing images, except images that the user listed for training: these are errors. Throws
/// Error(ExitCode::input or usage).
ViewSplit split_views(const SceneOptions& options,
                      const std::vector<std::string>& names,
                      const std::vector<bool>& exists,
                      const std::vector<std::string>& own_train = {},
                      const std::vector<std::string>& own_test = {});

}  // namespace tvsgs
