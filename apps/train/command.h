// tvsgs-train as a function, for commands that train.
#pragma once

namespace tvsgs {

/// Scene in, splats out: parses, calls the train loop, writes the run folder. Returns 0, also where
/// a stopped training has been saved. Throws Error.
int train_command(int argc, char* const* argv);

}  // namespace tvsgs
