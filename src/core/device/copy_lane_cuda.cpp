#include <cstring>

#include "core/device/copy_lane.h"
#include "core/device/cuda_runtime.h"

namespace tvsgs {

struct CopyLane<Cuda>::State {
    cudaStream_t stream = nullptr;
    cudaEvent_t given = nullptr, copied = nullptr;
    void* staging = nullptr;  // pinned memory, which the device reads directly

    explicit State(std::size_t capacity) {
        // Events order this stream with the default stream, which does all other work.
        check_cuda(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking));
        check_cuda(cudaEventCreateWithFlags(&given, cudaEventDisableTiming));
        check_cuda(cudaEventCreateWithFlags(&copied, cudaEventDisableTiming));
        if (capacity > 0) check_cuda(cudaMallocHost(&staging, capacity));
    }
    State(const State&) = delete;
    State& operator=(const State&) = delete;
    ~State() {  // errors here show at the next checked call
        if (stream != nullptr) cudaStreamSynchronize(stream);
        cudaFreeHost(staging);
        if (copied != nullptr) cudaEventDestroy(copied);
        if (given != nullptr) cudaEventDestroy(given);
        if (stream != nullptr) cudaStreamDestroy(stream);
    }
};

CopyLane<Cuda>::CopyLane(std::size_t capacity) : state_(std::make_unique<State>(capacity)) {}
CopyLane<Cuda>::CopyLane(CopyLane&&) noexcept = default;
CopyLane<Cuda>::~CopyLane() = default;

void CopyLane<Cuda>::start(const void* from, void* to, std::size_t bytes) {
    if (bytes == 0) return;
    const State& s = *state_;
    check_cuda(cudaEventSynchronize(s.copied));  // the last copy has left the staging memory
    std::memcpy(s.staging, from, bytes);
    check_cuda(cudaEventRecord(s.given));  // earlier work may still read `to`
    check_cuda(cudaStreamWaitEvent(s.stream, s.given));
    check_cuda(cudaMemcpyAsync(to, s.staging, bytes, cudaMemcpyHostToDevice, s.stream));
    check_cuda(cudaEventRecord(s.copied, s.stream));
}

void CopyLane<Cuda>::wait() {
    check_cuda(cudaStreamWaitEvent(nullptr, state_->copied));
}

}  // namespace tvsgs
