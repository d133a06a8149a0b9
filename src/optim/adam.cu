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

}  // namespace tvsgs
