// Checked calls of the CUDA runtime, and the choice of a GPU. Only for files of a CUDA build.
#pragma once

#include <cuda_runtime.h>

#include <source_location>

namespace tvsgs {

/// Throws Error with the call's place and CUDA's own words when `status` is not success.
void check_cuda(cudaError_t status, std::source_location where = std::source_location::current());

/// Success when this program holds code that the current GPU can run.
cudaError_t find_device_code();

}  // namespace tvsgs
