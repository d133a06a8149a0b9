// What this program was built of, and which commands were built with it.
#pragma once

#include <vector>

namespace tvsgs {

/// What --version says: the version on its first line, then the build, its device code and its
/// libraries.
extern const char* const kBuildInfo;

struct CommandEntry {
    const char* name;     // tvsgs-train
    const char* summary;  // one line
    const char* package;  // that it is installed by
};

/// In the order of apps/CMakeLists.txt, without `tvsgs` itself.
const std::vector<CommandEntry>& built_commands();

}  // namespace tvsgs
