// What a build without libwebp has instead of webp.cpp.
#include "core/error.h"
#include "io/webp.h"

namespace tvsgs {

bool has_webp() {
    return false;
}

std::string webp_bytes(const ImageU8&, int) {
    throw Error(ExitCode::usage,
                "WebP: this build has no libwebp; take jpg or png, or build where libwebp-dev is");
}

}  // namespace tvsgs
