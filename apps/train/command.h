// tvsgs-train as a function, for commands that train.
#pragma once

namespace tvsgs {

/// Scene in, splats out: parses, calls the train loop, writes the run folder. Throws as commands
/// do; 0 otherwise, also where a training that was stopped has been saved.
int train_command(int argc, char* const* argv);

}  // namespace tvsgs
