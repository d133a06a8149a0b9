// Checks that photographs can show a surface, before a training that cannot.
#pragma once

#include <vector>

#include "core/scene/scene.h"

namespace tvsgs {

/// Throws Error(ExitCode::input) if the training photographs are a few pixels wide, if all are
/// blank, or if all have the same pixels. Warns if some are blank, or repeat others.
void check_photographs(const std::vector<View>& train);

}  // namespace tvsgs
