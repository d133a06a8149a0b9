#include "mesh/fuse/spill_file.h"

#include <filesystem>

namespace tvsgs {
namespace {

/// Makes the folder; ignores a failure, because creating the file reports it.
const std::string& made(const std::string& folder) {
    std::error_code code;
    std::filesystem::create_directories(folder, code);
    return folder;
}

}  // namespace

SpillFile::SpillFile(const std::string& folder)
    : file_(made(folder), "what does not fit into --memory is kept in this folder for a while") {}

}  // namespace tvsgs
