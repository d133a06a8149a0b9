#include "optim/adam.h"

namespace tvsgs {

void update_parameters(Cpu, int count, const AdamBody& body, const int* halted) {
    // Asked once: a loop that asks every time is three times as slow.
    if (halted == nullptr || *halted == 0) parallel_for(Cpu{}, count, body);
}

}  // namespace tvsgs
