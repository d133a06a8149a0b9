// Which views train and which test.  [docs/guide/input.md#training-and-test-views]
#pragma once

#include <string>
#include <vector>

#include "io/scene/scene_options.h"

namespace tvsgs {

struct ViewSplit {
    std::vector<int> train, test;  // indices into the names, ascending, no index in both
};

/// `names`: all images of the model, sorted; `exists`: which of them are on disk. `own_train` and
/// `own_test` are the split that the scene comes with, by name; it counts where no list was asked
/// for, also with --eval. Images that are
/// missing are left out, but one that the user asked to train on by name is an error. Throws
/// Error(ExitCode::input or usage).
ViewSplit split_views(const SceneOptions& options,
                      const std::vector<std::string>& names,
                      const std::vector<bool>& exists,
                      const std::vector<std::string>& own_train = {},
                      const std::vector<std::string>& own_test = {});

}  // namespace tvsgs
