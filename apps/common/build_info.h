// Version and configuration of this build, and the list of its commands.
#pragma once

#include <vector>

namespace tvsgs {

/// Text of --version: the version on the first line, then the build, its device code and its
/// libraries.
extern const char* const kBuildInfo;

struct CommandEntry {
    const char* name;     // such as tvsgs-train
    const char* summary;  // one line
    const char* package;  // the package that contains it
};

/// In the order of apps/CMakeLists.txt, without `tvsgs` itself.
const std::vector<CommandEntry>& built_commands();

}  // namespace tvsgs
