#include "optim/optimiser/adam.h"
#include "render/tiles/fused_gradients.h"

namespace tvsgs {
namespace {

struct HaltingAdamBody {
    AdamBody body;
    const int* halted;  // device memory

    __device__ void operator()(int i) const {
        if (halted == nullptr || *halted == 0) body(i);
    }
};

constexpr int kThreads = 128, kBlocks = 5;  // per multiprocessor: many loads in flight
// Few SH coefficients at a time save registers; more than one keeps several loads in flight.
constexpr int kHarmonics = 2;

template <SplatVjp Vjp>
__global__ void __launch_bounds__(kThreads, kBlocks)
    step_kernel(int count, Vjp vjp, AdamStep step) {
    if (step.halted != nullptr && *step.halted != 0) return;
    const int i = int(blockIdx.x * kThreads + threadIdx.x);
    if (i >= count) return;
    ShStep<kHarmonics> sh{step.sh, i, step.sh_scale};
    if (step_splat(vjp, step, i, sh)) sh.decay();
}

}  // namespace

void update_parameters(Cuda, int count, const AdamBody& body, const int* halted) {
    parallel_for(Cuda{}, count, HaltingAdamBody{body, halted});
}

void take_step(Cuda, int count, const FusedGradients& gradients, const AdamStep& step) {
    if (count == 0) return;
    const int blocks = (count + kThreads - 1) / kThreads;
    gradients.visit([&]<class Vjp>(const Vjp& vjp) {
        step_kernel<Vjp><<<blocks, kThreads>>>(count, vjp, step);
    });
    check_launch();
}

}  // namespace tvsgs
