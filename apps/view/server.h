// Serves the page of a run to browsers on this machine, also during a training.
#pragma once

#include "report/view_page.h"

namespace tvsgs {

/// Serves at 127.0.0.1 until the process ends; prints the address with the access token on standard
/// output. `port`: 0: any. Shows one run. Makes the page again on request if the run has changed;
/// requests name no files. Throws Error(ExitCode::usage) if the port is taken.
void serve(const ViewInput& input, const ViewPageOptions& options, int port);

}  // namespace tvsgs
