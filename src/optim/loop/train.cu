#include "optim/loop/train_loop.h"

namespace tvsgs {

template void add_loss<Cuda>(const TermOnList&, MakeLoss<Cuda>);
template Gaussians<Cuda> train<Cuda>(
    const Scene&, const TrainOptions&, const TrainCallbacks&, const AfterStep<Cuda>&, SharedState);

}  // namespace tvsgs
