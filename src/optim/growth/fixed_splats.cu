#include "core/device/parallel.h"
#include "optim/growth/fixed_splats.h"

namespace tvsgs {

void add_numbers(Cuda, int count, const AddNumbersBody& body) {
    parallel_for(Cuda{}, count, body);
}

}  // namespace tvsgs
