#pragma once

#include <string>

namespace tvsgs {

/// Makes GPU `index` the current one and returns its description. Throws Error(ExitCode::device)
/// when there is none, when the driver is too old, or when the build holds no code for it.
std::string use_cuda_device(int index);

/// Number of usable GPUs; 0 without a driver.
int cuda_device_count();

}  // namespace tvsgs
