// GPUs that cannot be used: how they are told.
#include <gtest/gtest.h>

#include "core/device/cuda_device.h"
#include "core/device/cuda_runtime.h"
#include "core/error.h"

namespace tvsgs {
namespace {

TEST(Device, StatusesThatMeanThereIsNoUsableGpu) {
    const auto code_of = [](cudaError_t status) {
        try {
            check_cuda(status);
        } catch (const Error& error) {
            EXPECT_NE(std::string(error.what()).find(cudaGetErrorString(status)),
                      std::string::npos);
            return error.code();
        }
        return ExitCode::done;
    };
    EXPECT_EQ(code_of(cudaSuccess), ExitCode::done);
    for (const cudaError_t status :
         {cudaErrorNoDevice, cudaErrorInsufficientDriver, cudaErrorNoKernelImageForDevice,
          cudaErrorInvalidDeviceFunction})
        EXPECT_EQ(code_of(status), ExitCode::device) << status;
    EXPECT_EQ(code_of(cudaErrorMemoryAllocation), ExitCode::memory);
    EXPECT_EQ(code_of(cudaErrorIllegalAddress), ExitCode::internal);
}

TEST(Device, CodeForThisGpuIsFound) {
    if (cuda_device_count() == 0) {
        EXPECT_NE(find_device_code(), cudaSuccess) << "without a GPU there is no code for it";
        return;
    }
    EXPECT_FALSE(use_cuda_device(0).empty());
    EXPECT_EQ(find_device_code(), cudaSuccess);
    EXPECT_EQ(cudaGetLastError(), cudaSuccess);
}

}  // namespace
}  // namespace tvsgs
