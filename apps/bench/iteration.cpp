#include "apps/bench/iteration_loop.h"

namespace tvsgs {

template class BenchIteration<Cpu>;

}  // namespace tvsgs
