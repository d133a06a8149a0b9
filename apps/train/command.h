// tvsgs-train as a function, for commands that train.
#pragma once

namespace tvsgs {

/// Scene in, splats out: parses, calls the train loop, writes the run folder. Returns 0, also where
/// a stopped training has been saved. Throws Error. `for_blocks`: tvsgs-blocks tells the user what
/// to do next.
int train_command(int argc, char* const* argv, bool for_blocks = false);

}  // namespace tvsgs
