#include "optim/adam.h"

namespace tvsgs {

void update_parameters(Cpu, int count, const AdamBody& body, const int* halted) {
    // Asked once: a loop that asks every time is three times as slow.
    if (halted == nullptr || *halted == 0) parallel_for(Cpu{}, count, body);
}

// All harmonics of a Gaussian side by side, so that loops over them vectorise.
void take_step(Cpu, int count, const AdamStep& step) {
    with_step_body<kMaxShCount>(step, [&](const auto& body) { parallel_for(Cpu{}, count, body); });
}

void catch_up(Cpu, int count, const ShAdam& sh, Span<const float> radii_px) {
    parallel_for(Cpu{}, count, CatchUpBody<kMaxShCount>{sh, radii_px});
}

}  // namespace tvsgs
