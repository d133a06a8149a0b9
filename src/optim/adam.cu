#include "optim/adam.h"
#include "optim/asked_harmonics_impl.h"
#include "optim/waiting_harmonics_impl.h"
#include "render/fused_gradients.h"

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
// Few harmonics at a time: registers. More than one, so that several loads are under way.
constexpr int kHarmonics = 2;

template <SplatVjp Vjp, bool kWaits>
__global__ void __launch_bounds__(kThreads, kBlocks)
    step_kernel(int count, Vjp vjp, AdamStep step) {
    if (step.halted != nullptr && *step.halted != 0) return;
    const int i = static_cast<int>(blockIdx.x * kThreads + threadIdx.x);
    if (i >= count) return;
    if constexpr (kWaits) {
        step_splat_in_view<kHarmonics>(vjp, step, i);
    } else {
        ShStep<kHarmonics> sh{step.sh, i, step.sh_scale};
        if (step_splat(vjp, step, i, sh)) sh.decay();
    }
}

}  // namespace

void update_parameters(Cuda, int count, const AdamBody& body, const int* halted) {
    parallel_for(Cuda{}, count, HaltingAdamBody{body, halted});
}

void take_step(Cuda, int count, const FusedGradients& gradients, const AdamStep& step) {
    if (count == 0) return;
    const int blocks = (count + kThreads - 1) / kThreads;
    gradients.visit([&]<class Vjp>(const Vjp& vjp) {
        if (step.taken == nullptr)
            step_kernel<Vjp, false><<<blocks, kThreads>>>(count, vjp, step);
        else
            step_kernel<Vjp, true><<<blocks, kThreads>>>(count, vjp, step);
    });
    check_launch();
}

template void fetch_in_view(Cuda, const WaitingArrays&);
template void bring_back(Cuda, const WaitingArrays&);
template void catch_up(Cuda, const WaitingArrays&);
template void find_part_edges(Cuda, Span<const std::uint32_t>, int, std::uint32_t*);
template void list_asked(Cuda, const SplatPlaces&, Part, std::uint32_t, Span<int>);
template void give_rows(Cuda, const MovingHarmonics&, Span<const int>, Vec3f*);
template void take_rows(Cuda, const MovingHarmonics&, Span<const int>, const Vec3f*);

}  // namespace tvsgs
