// Messages for people, on standard error only. Not for CUDA sources.
#pragma once

#include <spdlog/spdlog.h>

namespace tvsgs {

enum class Verbosity { quiet, normal, verbose };

/// Sends all messages to standard error as `level: text`; quiet keeps warnings and errors, and
/// shows no progress (core/progress.h).
void init_log(Verbosity verbosity);

}  // namespace tvsgs
