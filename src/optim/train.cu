#include "optim/losses_list.h"
#include "optim/train_loop.h"

namespace tvsgs {

void synchronize(Cuda) {
    check_cuda(cudaDeviceSynchronize());
}

template Gaussians<Cuda> train<Cuda>(const Scene&, const TrainOptions&, const TrainCallbacks&);

}  // namespace tvsgs
