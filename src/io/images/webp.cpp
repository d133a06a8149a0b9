#include "io/images/webp.h"

#include <webp/decode.h>
#include <webp/encode.h>

#include "core/error.h"

namespace tvsgs {

std::string webp_bytes(const ImageU8& image, int quality) {
    std::uint8_t* encoded = nullptr;
    const std::size_t size = WebPEncodeRGB(image.pixels.data(), image.width, image.height,
                                           3 * image.width, static_cast<float>(quality), &encoded);
    std::string bytes(reinterpret_cast<const char*>(encoded), size);
    WebPFree(encoded);
    if (size == 0)
        throw Error(ExitCode::internal, "encoding a WebP of ", image.width, "x", image.height,
                    " failed");
    return bytes;
}

std::string webp_lossless_bytes(const ImageU8& image) {
    struct Picture : WebPPicture {
        ~Picture() { WebPPictureFree(this); }
    } picture;
    struct Memory : WebPMemoryWriter {
        ~Memory() { WebPMemoryWriterClear(this); }
    } memory;
    WebPConfig config;
    constexpr int kLevel = 6;  // of 0 to 9; higher levels take much longer and gain little
    const bool known = WebPPictureInit(&picture) && WebPConfigInit(&config) &&
                       WebPConfigLosslessPreset(&config, kLevel);
    WebPMemoryWriterInit(&memory);
    config.exact = 1;
    picture.use_argb = 1, picture.width = image.width, picture.height = image.height;
    picture.writer = WebPMemoryWrite, picture.custom_ptr = static_cast<WebPMemoryWriter*>(&memory);
    if (!known || !WebPPictureImportRGBA(&picture, image.pixels.data(), 4 * image.width) ||
        !WebPEncode(&config, &picture))
        throw Error(ExitCode::internal, "encoding a WebP of ", image.width, "x", image.height,
                    " failed: error ", picture.error_code);
    return {reinterpret_cast<const char*>(memory.mem), memory.size};
}

bool read_webp_size(std::string_view bytes, int& width, int& height, int& channels) {
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
