#include "optim/losses_list.h"
#include "optim/train_loop.h"

namespace tvsgs {

template Gaussians<Cpu> train<Cpu>(const Scene&,
                                   const TrainOptions&,
                                   const TrainCallbacks&,
                                   const AfterStep<Cpu>&);

}  // namespace tvsgs
