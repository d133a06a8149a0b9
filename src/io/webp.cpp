#include "io/webp.h"

#include <webp/encode.h>

#include "core/error.h"

namespace tvsgs {

bool has_webp() {
    return true;
}

std::string webp_bytes(const ImageU8& image, int quality) {
    std::uint8_t* encoded = nullptr;
    const std::size_t size = WebPEncodeRGB(image.pixels.data(), image.width, image.height,
                                           3 * image.width, static_cast<float>(quality), &encoded);
    std::string bytes(reinterpret_cast<const char*>(encoded), size);
    WebPFree(encoded);
    if (size == 0)
        throw Error(ExitCode::internal,
                    str("encoding a WebP of ", image.width, "x", image.height, " failed"));
    return bytes;
}

}  // namespace tvsgs
