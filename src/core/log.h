// Log messages on standard error. Not for CUDA sources.
#pragma once

#include <spdlog/spdlog.h>

namespace tvsgs {

enum class Verbosity { quiet, normal, verbose };

/// Sends all messages to standard error, warnings as `warning: text`. Quiet keeps warnings and
/// errors, and hides progress (core/progress.h).
void init_log(Verbosity verbosity);

}  // namespace tvsgs
