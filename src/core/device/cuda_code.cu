#include "core/device/cuda_runtime.h"

namespace tvsgs {
namespace {
__global__ void any_kernel() {}
}  // namespace

cudaError_t find_device_code() {
    cudaFuncAttributes attributes{};
    const cudaError_t status = cudaFuncGetAttributes(&attributes, any_kernel);
    if (status != cudaSuccess) cudaGetLastError();  // clears the error, which is an answer
    return status;
}

}  // namespace tvsgs
