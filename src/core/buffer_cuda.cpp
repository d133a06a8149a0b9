#include <atomic>

#include "core/buffer.h"
#include "core/cuda_device.h"
#include "core/cuda_runtime.h"
#include "core/error.h"

namespace tvsgs {
namespace {
std::atomic<std::int64_t> current_bytes{0}, peak_bytes{0};
}  // namespace

void check_cuda(cudaError_t status, std::source_location where) {
    if (status == cudaSuccess) return;
    const ExitCode code = status == cudaErrorMemoryAllocation ? ExitCode::memory
                          : status == cudaErrorNoDevice || status == cudaErrorInsufficientDriver ||
                                  status == cudaErrorNoKernelImageForDevice
                              ? ExitCode::device
                              : ExitCode::internal;
    throw Error(code, str("CUDA: ", cudaGetErrorString(status), " (", where.file_name(), ":",
                          where.line(), ")"));
}

MemoryUse memory_use(Cuda) {
    return {current_bytes, peak_bytes};
}

int cuda_device_count() {
    int count = 0;
    if (cudaGetDeviceCount(&count) != cudaSuccess) {
        cudaGetLastError();  // no driver is an answer here, not an error to meet again later
        return 0;
    }
    return count;
}

std::string use_cuda_device(int index) {
    int count = 0;
    if (const cudaError_t status = cudaGetDeviceCount(&count); status != cudaSuccess || count == 0)
        throw Error(ExitCode::device,
                    str("no usable GPU: ", cudaGetErrorString(status), "; use --device cpu"));
    if (index < 0 || index >= count)
        throw Error(ExitCode::device,
                    str("no GPU cuda:", index, ": there are ", count, ", numbered from 0"));
    check_cuda(cudaSetDevice(index));
    cudaDeviceProp properties{};
    check_cuda(cudaGetDeviceProperties(&properties, index));
    return properties.name;
}

namespace detail {

void* allocate(Cuda, std::size_t bytes) {
    if (bytes == 0) return nullptr;
    void* data = nullptr;
    if (const cudaError_t status = cudaMalloc(&data, bytes); status != cudaSuccess) {
        cudaGetLastError();
        std::size_t free_bytes = 0, total_bytes = 0;
        cudaMemGetInfo(&free_bytes, &total_bytes);
        if (status != cudaErrorMemoryAllocation) check_cuda(status);
        throw Error(ExitCode::memory, str("out of GPU memory: needed ", bytes >> 20, " MiB, ",
                                          free_bytes >> 20, " of ", total_bytes >> 20,
                                          " MiB are free; use fewer splats (--max-gaussians), "
                                          "smaller images (-r) or --device cpu"));
    }
    const std::int64_t now = current_bytes += static_cast<std::int64_t>(bytes);
    for (std::int64_t peak = peak_bytes;
         now > peak && !peak_bytes.compare_exchange_weak(peak, now);) {
    }
    return data;
}

void release(Cuda, void* data, std::size_t bytes) {
    if (data == nullptr) return;
    cudaFree(data);  // runs in destructors: an error here shows at the next checked call
    current_bytes -= static_cast<std::int64_t>(bytes);
}

void fill_zero(Cuda, void* data, std::size_t bytes) {
    if (bytes > 0) check_cuda(cudaMemsetAsync(data, 0, bytes));
}

void copy(Cpu, const void* from, Cuda, void* to, std::size_t bytes) {
    if (bytes > 0) check_cuda(cudaMemcpy(to, from, bytes, cudaMemcpyHostToDevice));
}
void copy(Cuda, const void* from, Cpu, void* to, std::size_t bytes) {
    if (bytes > 0) check_cuda(cudaMemcpy(to, from, bytes, cudaMemcpyDeviceToHost));
}
void copy(Cuda, const void* from, Cuda, void* to, std::size_t bytes) {
    if (bytes > 0) check_cuda(cudaMemcpyAsync(to, from, bytes, cudaMemcpyDeviceToDevice));
}

}  // namespace detail

void synchronize(Cuda) {
    check_cuda(cudaDeviceSynchronize());
}

}  // namespace tvsgs
