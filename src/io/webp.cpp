#include "io/webp.h"

#include <webp/decode.h>
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

bool read_webp_size(
    const std::string&, std::string_view bytes, int& width, int& height, int& channels) {
    WebPBitstreamFeatures features;
    if (WebPGetFeatures(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size(),
                        &features) != VP8_STATUS_OK ||
        features.has_animation)
        return false;
    width = features.width, height = features.height, channels = features.has_alpha ? 4 : 3;
    return true;
}

bool decode_webp(std::string_view bytes, ImageU8& image) {
    const auto* const data = reinterpret_cast<const std::uint8_t*>(bytes.data());
    const int row = image.width * image.channels;
    return (image.channels == 4 ? WebPDecodeRGBAInto : WebPDecodeRGBInto)(
               data, bytes.size(), image.pixels.data(), image.pixels.size(), row) != nullptr;
}

}  // namespace tvsgs
