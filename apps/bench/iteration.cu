#include "apps/bench/iteration_loop.h"

namespace tvsgs {

template IterationTimes time_iteration<Cuda>(
    const Scene&, const TrainOptions&, const Gaussians<Cpu>&, int, int);

}  // namespace tvsgs
