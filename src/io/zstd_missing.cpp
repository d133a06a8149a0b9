// What a build without libzstd has instead of zstd.cpp.
#include "core/error.h"
#include "io/read_file.h"
#include "io/zstd.h"

namespace tvsgs {

bool has_zstd() {
    return false;
}

std::vector<std::uint8_t> zstd_frame(std::span<const std::uint8_t>) {
    throw Error(ExitCode::usage,
                "SPZ version 4: this build has no libzstd; take --spz-version 3, or build where "
                "libzstd-dev is");
}

void read_zstd_frame(std::span<const std::uint8_t>,
                     std::span<std::uint8_t>,
                     const std::string& where) {
    throw input_error(where,
                      ": packed by zstd, and this build has no libzstd; bring SPZ version 2 or 3, "
                      "or build where libzstd-dev is");
}

}  // namespace tvsgs
