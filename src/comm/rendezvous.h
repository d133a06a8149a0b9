// How processes find each other that no MPI has started: the first one writes a file.
#pragma once

#include <functional>
#include <string>

#include "comm/launch.h"

namespace tvsgs {

/// `text` in `file`, which appears whole. Throws Error(ExitCode::io).
void publish(const std::string& file, const std::string& text);

/// The text of `file`, once it is there with so many bytes. keep_waiting(seconds) is called again
/// and again, and ends the wait by what it throws.
std::string await_text(const std::string& file,
                       std::size_t bytes,
                       const std::function<void(double)>& keep_waiting);

/// comm.rendezvous, or a name in the folder for temporary files by the launcher's job. Throws
/// Error(ExitCode::usage) where neither is known.
std::string rendezvous_file(const Launch& launch, const CommOptions& options);

}  // namespace tvsgs
