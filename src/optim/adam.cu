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

}  // namespace

void update_parameters(Cuda, int count, const AdamBody& body, const int* halted) {
    parallel_for(Cuda{}, count, HaltingAdamBody{body, halted});
}

// Few harmonics at a time: registers. More than one, so that several loads are under way.
void take_step(Cuda, int count, const AdamStep& step) {
    take_step_as<2>(Cuda{}, count, step);
}

void catch_up(Cuda, int count, const ShAdam& sh, Span<const float> radii_px) {
    parallel_for(Cuda{}, count, CatchUpBody<2>{sh, radii_px});
}

}  // namespace tvsgs
