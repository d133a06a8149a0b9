// tvsgs-train as a function, for commands that train.
#pragma once

#include <functional>
#include <memory>

#include "comm/launch.h"

namespace tvsgs {

/// How this process is one of several. The commands that can be are linked with the libraries for
/// it, the others hand over one by itself.
struct Processes {
    Launch launch;
    std::unique_ptr<Communicator> peers;  // by MPI, in the end by NCCL where there are GPUs
    std::function<decltype(join_by_nccl)> join_gpus;
    bool gpus_can_meet = false;  // has_nccl()
};

/// Scene in, splats out: parses, calls the train loop, writes the run folder. Throws as commands
/// do; 0 otherwise, also where a training that was stopped has been saved.
int train_command(int argc, char* const* argv);

/// The same as one of several processes, of which the first one logs and writes.
int train_command(int argc, char* const* argv, Processes& job);

}  // namespace tvsgs
