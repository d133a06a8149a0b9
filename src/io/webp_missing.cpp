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

bool read_webp_size(const std::string& where, std::string_view, int&, int&, int&) {
    throw Error(ExitCode::input, str("E_IMAGE_READ: ", where,
                                     ": a WebP, and this build has no libwebp; convert it to PNG, "
                                     "or build where libwebp-dev is"));
}

bool decode_webp(std::string_view, ImageU8&) {
    return false;
}

}  // namespace tvsgs
