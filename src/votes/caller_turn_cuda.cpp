#include "core/device/cuda_runtime.h"
#include "votes/caller_turn.h"

namespace tvsgs {
namespace {
cudaEvent_t event_of(void* handle) {
    return static_cast<cudaEvent_t>(handle);
}
}  // namespace

int current_gpu() {
    int gpu = -1;
    if (cudaGetDevice(&gpu) == cudaSuccess) return gpu;
    cudaGetLastError();  // clears the error: no driver is a valid answer here
    return -1;
}

void KeptGpu::restore() const {
    if (gpu_ >= 0) cudaSetDevice(gpu_);
}

CallerTurn<Cuda>::CallerTurn(int gpu, void* stream) : stream_(stream) {
    check_cuda(cudaSetDevice(gpu));
    cudaEvent_t event = nullptr;
    check_cuda(cudaEventCreateWithFlags(&event, cudaEventDisableTiming));
    event_.handle = event;
    check_cuda(cudaEventRecord(event, static_cast<cudaStream_t>(stream)));
    check_cuda(cudaStreamWaitEvent(nullptr, event));
}

CallerTurn<Cuda>::~CallerTurn() {  // errors here show at the next checked call
    cudaEventRecord(event_of(event_.handle));
    cudaStreamWaitEvent(static_cast<cudaStream_t>(stream_), event_of(event_.handle));
}

CallerTurn<Cuda>::Event::~Event() {
    if (handle != nullptr) cudaEventDestroy(event_of(handle));
}

void CallerTurn<Cuda>::copy(const void* from, void* to, std::size_t bytes) const {
    if (bytes > 0) check_cuda(cudaMemcpy(to, from, bytes, cudaMemcpyDefault));
}

}  // namespace tvsgs
