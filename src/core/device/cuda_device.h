// Selection of a GPU, for code that does not include CUDA headers.
#pragma once

#include <string>

namespace tvsgs {

/// Makes GPU `index` the current one and returns its description. Throws Error(ExitCode::device)
/// when there is no such GPU, when the driver is too old, or when the build holds no code for the
/// GPU.
std::string use_cuda_device(int index);

/// Number of usable GPUs; 0 without a driver.
int cuda_device_count();

}  // namespace tvsgs
