// The page of a run from this machine to its own browser, and of a training while it goes on.
#pragma once

#include "report/view_run.h"

namespace tvsgs {

/// Serves at 127.0.0.1 until the process ends; prints the address, with the token without which
/// nothing is told, on standard output. `port`: 0: any. One run. The page is made anew when it is
/// asked for and the run has changed; requests name no files. Throws Error(ExitCode::usage) when
/// the port is taken.
void serve(const ViewInput& input, const ViewPageOptions& options, int port);

}  // namespace tvsgs
