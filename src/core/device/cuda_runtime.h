// Error checks for calls of the CUDA runtime. Only for files of a CUDA build.
#pragma once

#include <cuda_runtime.h>

#include <source_location>

namespace tvsgs {

/// Throws Error with the place of the call and CUDA's message unless `status` is success.
void check_cuda(cudaError_t status, std::source_location where = std::source_location::current());

/// Returns success when this program holds code that the current GPU can run.
cudaError_t find_device_code();

}  // namespace tvsgs
