#include "optim/losses_list.h"
#include "optim/train_loop.h"

namespace tvsgs {

int iterations_done(const State& state) {
    int done = 0;
    StateVisitor<Cpu>(state).value("iterations", done);
    return done;
}

template Gaussians<Cpu> train<Cpu>(const Scene&,
                                   const TrainOptions&,
                                   const TrainCallbacks&,
                                   const AfterStep<Cpu>&,
                                   const SharedState&);

}  // namespace tvsgs
