#include "bench_iteration_loop.h"

namespace tvsgs {

template class BenchIteration<Cuda>;

}  // namespace tvsgs
