#include "optim/adam.h"

namespace tvsgs {
namespace {

struct HaltingAdamBody {
    AdamBody body;
    const int* halted;  // on the device

    __device__ void operator()(int i) const {
        if (halted == nullptr || *halted == 0) body(i);
    }
};

constexpr int kThreads = 128, kBlocks = 5;  // of a multiprocessor: many loads under way
template <class Body>
__global__ void __launch_bounds__(kThreads, kBlocks) step_kernel(int count, Body body) {
    const int i = static_cast<int>(blockIdx.x * kThreads + threadIdx.x);
    if (i < count) body(i);
}

}  // namespace

void update_parameters(Cuda, int count, const AdamBody& body, const int* halted) {
    parallel_for(Cuda{}, count, HaltingAdamBody{body, halted});
}

// Few harmonics at a time: registers. More than one, so that several loads are under way.
constexpr int kHarmonics = 2;

void take_step(Cuda, int count, const AdamStep& step) {
    if (count == 0) return;
    with_step_body<kHarmonics>(step, [&](const auto& body) {
        step_kernel<<<(count + kThreads - 1) / kThreads, kThreads>>>(count, body);
        check_launch();
    });
}

void catch_up(Cuda, int count, const ShAdam& sh, Span<const float> radii_px) {
    parallel_for(Cuda{}, count, CatchUpBody<kHarmonics>{sh, radii_px});
}

}  // namespace tvsgs
