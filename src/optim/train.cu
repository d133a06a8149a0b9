#include "optim/losses_list.h"
#include "optim/train_loop.h"

namespace tvsgs {

template Gaussians<Cuda> train<Cuda>(const Scene&,
                                     const TrainOptions&,
                                     const TrainCallbacks&,
                                     const AfterStep<Cuda>&,
                                     const SharedState&);

}  // namespace tvsgs
