#include "optim/growth/fixed_splats.h"

#include "core/device/parallel.h"

namespace tvsgs {

void add_numbers(Cpu, int count, const AddNumbersBody& body) {
    parallel_for(Cpu{}, count, body);
}

}  // namespace tvsgs
