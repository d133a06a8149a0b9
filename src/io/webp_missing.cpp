// What a build without libwebp has instead of webp.cpp.
#include "core/error.h"
#include "io/webp.h"

namespace tvsgs {
namespace {

[[noreturn]] void refuse(const char* instead) {
    throw Error(ExitCode::usage, str("WebP: this build has no libwebp; ", instead,
                                     ", or build where libwebp-dev is"));
}

}  // namespace

bool has_webp() {
    return false;
}

std::string webp_bytes(const ImageU8&, int) {
    refuse("take jpg or png");
}

std::string webp_lossless_bytes(const ImageU8&) {
    refuse("name a .spz");
}

ImageU8 decode_webp(std::string_view, const std::string&, std::int64_t) {
    refuse("bring another format");
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
