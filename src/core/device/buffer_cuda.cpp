#include "core/device/cuda_device.h"
#include "core/device/cuda_runtime.h"
#include "core/device/memory_ledger.h"
#include "core/error.h"
#include "core/grouped.h"

namespace tvsgs {
namespace {
MemoryLedger ledger;

/// For example: the driver is too old, or the program holds no code for the GPU.
bool no_usable_device(cudaError_t status) {
    return status == cudaErrorNoDevice || status == cudaErrorInsufficientDriver ||
           status == cudaErrorNoKernelImageForDevice || status == cudaErrorInvalidDeviceFunction;
}
}  // namespace

void check_cuda(cudaError_t status, std::source_location where) {
    if (status == cudaSuccess) return;
    const std::string what =
        str("CUDA: ", cudaGetErrorString(status), " (", where.file_name(), ":", where.line(), ")");
    if (status == cudaErrorMemoryAllocation) throw out_of_memory(what);
    throw Error(no_usable_device(status) ? ExitCode::device : ExitCode::internal, what);
}

MemoryUse memory_use(Cuda) {
    return ledger.use();
}

void set_memory_limit(Cuda, std::int64_t bytes) {
    ledger.limit = bytes;
}

int cuda_device_count() {
    int count = 0;
    if (cudaGetDeviceCount(&count) != cudaSuccess) {
        cudaGetLastError();  // clears the error: no driver is a valid answer here
        return 0;
    }
    return count;
}

std::string use_cuda_device(int index) {
    int count = 0;
    if (const cudaError_t status = cudaGetDeviceCount(&count); status != cudaSuccess || count == 0)
        throw Error(ExitCode::device, "no usable GPU: ", cudaGetErrorString(status),
                    "; use --device cpu");
    if (index < 0 || index >= count)
        throw Error(ExitCode::device, "no GPU cuda:", index, " on this machine; found ", count,
                    ", numbered from 0");
    check_cuda(cudaSetDevice(index));
    cudaDeviceProp properties{};
    check_cuda(cudaGetDeviceProperties(&properties, index));
    if (const cudaError_t status = find_device_code(); status != cudaSuccess)
        throw Error(ExitCode::device, "GPU cuda:", index, ", ", properties.name,
                    ", compute capability ", properties.major, ".", properties.minor,
                    ": this build has no code for it (", cudaGetErrorString(status),
                    "); build with -DCMAKE_CUDA_ARCHITECTURES=", properties.major, properties.minor,
                    ", or use --device cpu");
    return properties.name;
}

namespace detail {

void* allocate(Cuda, std::size_t bytes) {
    if (bytes == 0) return nullptr;
    void* data = nullptr;
    const std::int64_t held = ledger.current;
    if (!ledger.allows(bytes))
        throw out_of_memory(str("GPU memory: ", grouped(bytes), " more bytes needed, ",
                                grouped(held >> 20), " MiB in use, limit ",
                                grouped(ledger.limit >> 20), " MiB (--gpu-memory)"));
    if (const cudaError_t status = cudaMalloc(&data, bytes); status != cudaSuccess) {
        cudaGetLastError();
        std::size_t free_bytes = 0, total_bytes = 0;
        cudaMemGetInfo(&free_bytes, &total_bytes);
        if (status != cudaErrorMemoryAllocation) check_cuda(status);
        throw out_of_memory(str("GPU memory: ", grouped(bytes), " more bytes needed, ",
                                grouped(held >> 20), " MiB in use, ", grouped(free_bytes >> 20),
                                " of ", grouped(total_bytes >> 20), " MiB free"));
    }
    ledger.take(bytes);
    return data;
}

void release(Cuda, void* data, std::size_t bytes) {
    if (data == nullptr) return;
    // Called by destructors: an error shows at the next checked call.
    cudaFree(data);
    ledger.give_back(bytes);
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
