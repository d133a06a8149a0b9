#include "io/images/image_file.h"

#include <webp/decode.h>
#include <webp/encode.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <memory>

#include "core/device/parallel.h"
#include "core/error.h"
#include "core/grouped.h"
#include "io/files/atomic_file.h"
#include "io/files/read_file.h"
#include "io/images/stb.h"

namespace tvsgs {
namespace {

using std::string_view_literals::operator""sv;

struct StbFree {
    void operator()(void* pixels) const { stbi_image_free(pixels); }
};

bool is_webp(std::string_view bytes) {
    return bytes.starts_with("RIFF") && bytes.substr(0, 12).ends_with("WEBP");
}

/// Name of an unsupported format by the file's first bytes; empty if unknown.
std::string kind_of_file(std::string_view bytes) {
    if (bytes.starts_with("II*") || bytes.starts_with("MM\0*"sv)) return "a TIFF or raw photograph";
    if (bytes.size() >= 12 && bytes.substr(4, 4) == "ftyp")
        return str("HEIC, AVIF or similar, kind '", shown(bytes.substr(8, 4)), "'");
    if (bytes.starts_with("\x76\x2F\x31\x01")) return "an OpenEXR";
    return "";
}

ImageSize checked_size(const std::string& path,
                       std::string_view bytes,
                       bool known,
                       const ImageSize& size,
                       std::int64_t max_pixels = kMaxPixels) {
    const auto [width, height, channels] = size;
    if (bytes.empty())
        throw input_error("E_IMAGE_READ: ", path, " is empty (0 bytes); copy it again");
    if (!known) {
        const std::string kind = kind_of_file(bytes);
        throw input_error("E_IMAGE_READ: ", path, ": cannot read it as an image (",
                          !kind.empty()    ? kind
                          : is_webp(bytes) ? "damaged or animated WebP"
                                           : stbi_failure_reason(),
                          "); expected JPEG, PNG, WebP or BMP: convert it to PNG and keep the name "
                          "before the ending");
    }
    if (width < 1 || height < 1 || std::int64_t{width} * height > max_pixels)
        throw input_error("E_IMAGE_READ: ", path, ": ", width, "x", height,
                          " pixels: too large (limit ", grouped(max_pixels), " pixels)");
    return {width, height, channels};
}

/// Checks that chunks fit into the file, because stb allocates the claimed size first.
void check_png_chunks(const std::string& path, std::string_view bytes) {
    if (!bytes.starts_with("\x89PNG\r\n\x1A\n")) return;
    constexpr std::size_t kFrame = 12;  // length, type and checksum of a chunk
    for (std::size_t at = 8; at + kFrame <= bytes.size();) {
        std::size_t length = 0;
        for (std::size_t i = at; i < at + 4; ++i)
            length = length << 8 | static_cast<unsigned char>(bytes[i]);
        if (bytes.substr(at + 4, 4) == "IEND") return;
        if (length > bytes.size() - at - 8)
            throw input_error("E_IMAGE_READ: ", path, ": the chunk at byte ", at, " claims ",
                              length, " bytes of ", bytes.size() - at - 8,
                              "; the file may be cut off: copy it again");
        at += kFrame + length;
    }
}

/// Reads the size from the bytes of a file, or from its first bytes.
ImageSize size_in(const std::string& path, std::string_view bytes, std::int64_t max_pixels) {
    ImageSize size{};
    if (is_webp(bytes)) {
        const std::optional<ImageSize> found = webp_size(bytes);
        return checked_size(path, bytes, found.has_value(), found.value_or(size), max_pixels);
    }
    const bool known = stbi_info_from_memory(reinterpret_cast<const stbi_uc*>(bytes.data()),
                                             static_cast<int>(bytes.size()), &size.width,
                                             &size.height, &size.channels) != 0;
    return checked_size(path, bytes, known, size, max_pixels);
}

/// Pixels of a file with 8 or 16 bits, in `channels` channels (0: as many as the file has).
struct Decoded {
    ImageSize size;
    std::unique_ptr<stbi_us, StbFree> wide;    // 16 bits, or null
    std::unique_ptr<stbi_uc, StbFree> narrow;  // 8 bits, or null

    Decoded(const std::string& path,
            std::string_view bytes,
            int channels,
            std::int64_t max_pixels = kMaxPixels) {
        if (bytes.size() > static_cast<std::size_t>(std::numeric_limits<int>::max()))
            throw input_error("E_IMAGE_READ: ", path, ": the file is larger than 2 GiB");
        const auto* data = reinterpret_cast<const stbi_uc*>(bytes.data());
        const int length = static_cast<int>(bytes.size());
        size = size_in(path, bytes, max_pixels);
        check_png_chunks(path, bytes);
        if (channels == 0) channels = size.channels == 2 ? 4 : size.channels;
        size.channels = channels;
        int width = 0, height = 0, found = 0;
        if (stbi_is_16_bit_from_memory(data, length))
            wide.reset(stbi_load_16_from_memory(data, length, &width, &height, &found, channels));
        else
            narrow.reset(stbi_load_from_memory(data, length, &width, &height, &found, channels));
        if (!wide && !narrow)
            throw input_error("E_IMAGE_READ: ", path, ": decoding failed (", stbi_failure_reason(),
                              "); the file may be cut off: copy it again");
    }
};

ImageU8 decode_webp_image(const std::string& path,
                          std::string_view bytes,
                          int channels,
                          std::int64_t max_pixels) {
    const ImageSize size = size_in(path, bytes, max_pixels);
    ImageU8 image(size.width, size.height, channels == 0 ? size.channels : channels == 4 ? 4 : 3);
    const auto* const data = reinterpret_cast<const std::uint8_t*>(bytes.data());
    if (!(image.channels == 4 ? WebPDecodeRGBAInto : WebPDecodeRGBInto)(
            data, bytes.size(), image.pixels.data(), image.pixels.size(),
            image.width * image.channels))
        throw input_error("E_IMAGE_READ: ", path,
                          ": decoding failed; the file may be cut off: copy it again");
    return channels == 1 ? grey_of(image) : image;
}

/// Filter weights of one axis: output i is the sum of weights[i * taps + j] * input[first[i] + j].
struct Resampling {
    int taps = 0;
    std::vector<int> first;
    std::vector<float> weights;
};

/// Keys' cubic with a = -0.5.  [Keys81]
double cubic(double x) {
    x = std::abs(x);
    if (x < 1) return (1.5 * x - 2.5) * x * x + 1;
    if (x < 2) return ((-0.5 * x + 2.5) * x - 4) * x + 2;
    return 0;
}

Resampling cubic_resampling(int input, int output) {
    const double scale = static_cast<double>(input) / output;
    const double filter_scale = std::max(scale, 1.0);  // wider when shrinking, against aliasing
    const double support = 2 * filter_scale;
    Resampling r;
    r.taps = std::min(input, static_cast<int>(std::ceil(support)) * 2 + 1);
    r.first.resize(static_cast<std::size_t>(output));
    r.weights.assign(static_cast<std::size_t>(output) * r.taps, 0.0f);
    std::vector<double> weights(static_cast<std::size_t>(r.taps));
    for (int i = 0; i < output; ++i) {
        const double centre = (i + 0.5) * scale;
        const int begin = std::max(0, static_cast<int>(centre - support + 0.5));
        const int end = std::min(input, static_cast<int>(centre + support + 0.5));
        double sum = 0;
        for (int j = 0; j < end - begin; ++j)
            sum += weights[j] = cubic((begin + j - centre + 0.5) / filter_scale);
        // Near the border fewer than `taps` inputs remain. The window then starts earlier, with
        // zero weights.
        r.first[i] = std::min(begin, input - r.taps);
        float* const out = &r.weights[static_cast<std::size_t>(i) * r.taps + (begin - r.first[i])];
        for (int j = 0; j < end - begin; ++j) out[j] = static_cast<float>(weights[j] / sum);
    }
    return r;
}

std::uint8_t to_byte(float value) {
    return static_cast<std::uint8_t>(std::clamp(value + 0.5f, 0.0f, 255.0f));
}

Error encoding_error(const char* format, const ImageU8& image, const std::string& reason = "") {
    return Error(ExitCode::internal, "encoding a ", format, " of ", image.width, "x", image.height,
                 "x", image.channels, " failed", reason);
}

void append_bytes(void* out, void* data, int size) {
    static_cast<std::string*>(out)->append(static_cast<const char*>(data),
                                           static_cast<std::size_t>(size));
}

}  // namespace

bool has_image_extension(const std::string& path) {
    const std::string extension = lower_case(std::filesystem::path(path).extension().string());
    return std::ranges::find(kImageExtensions, extension) != std::end(kImageExtensions);
}

ImageSize read_image_size(const std::string& path) {
    int width = 0, height = 0, channels = 0;
    const OpenFile file = open_file(path);
    char start[64];  // enough for a WebP; a JPEG may store its size later
    const std::string_view head(start, std::fread(start, 1, sizeof start, file.get()));
    if (is_webp(head)) return size_in(path, head, kMaxPixels);
    std::rewind(file.get());
    const bool known = stbi_info_from_file(file.get(), &width, &height, &channels) != 0;
    return checked_size(path, head, known, {width, height, channels});
}

ImageU8 read_image(const std::string& path, int channels) {
    return decode_image(path, read_bytes(path), channels);
}

ImageU8 decode_image(const std::string& where,
                     std::string_view bytes,
                     int channels,
                     std::int64_t max_pixels) {
    if (is_webp(bytes)) return decode_webp_image(where, bytes, channels, max_pixels);
    const Decoded decoded(where, bytes, channels, max_pixels);
    ImageU8 image(decoded.size.width, decoded.size.height, decoded.size.channels);
    if (decoded.narrow)
        std::copy_n(decoded.narrow.get(), image.pixels.size(), image.pixels.data());
    else  // 65535 / 257 = 255: rounds to the nearest of 256 levels
        std::transform(decoded.wide.get(), decoded.wide.get() + image.pixels.size(),
                       image.pixels.data(),
                       [](int value) { return static_cast<std::uint8_t>((value + 128) / 257); });
    return image;
}

ImageF read_image_numbers(const std::string& path) {
    const Decoded decoded(path, read_bytes(path), 0);
    ImageF image(decoded.size.width, decoded.size.height, decoded.size.channels);
    for (std::size_t i = 0; i < image.pixels.size(); ++i)
        image.pixels[i] =
            static_cast<float>(decoded.wide ? int{decoded.wide.get()[i]} : decoded.narrow.get()[i]);
    return image;
}

std::string png_bytes(const ImageU8& image) {
    std::string bytes;
    if (!stbi_write_png_to_func(append_bytes, &bytes, image.width, image.height, image.channels,
                                image.pixels.data(), image.width * image.channels))
        throw encoding_error("PNG", image);
    return bytes;
}

std::string jpeg_bytes(const ImageU8& image, int quality) {
    std::string bytes;
    if (!stbi_write_jpg_to_func(append_bytes, &bytes, image.width, image.height, image.channels,
                                image.pixels.data(), quality))
        throw encoding_error("JPEG", image);
    return bytes;
}

std::string webp_bytes(const ImageU8& image, int quality) {
    std::uint8_t* encoded = nullptr;
    const std::size_t size = WebPEncodeRGB(image.pixels.data(), image.width, image.height,
                                           3 * image.width, static_cast<float>(quality), &encoded);
    std::string bytes(reinterpret_cast<const char*>(encoded), size);
    WebPFree(encoded);
    if (size == 0) throw encoding_error("WebP", image);
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
        throw encoding_error("WebP", image, str(": error ", picture.error_code));
    return {reinterpret_cast<const char*>(memory.mem), memory.size};
}

std::optional<ImageSize> webp_size(std::string_view bytes) {
    WebPBitstreamFeatures features;
    if (WebPGetFeatures(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size(),
                        &features) != VP8_STATUS_OK ||
        features.has_animation)
        return std::nullopt;
    return ImageSize{features.width, features.height, features.has_alpha ? 4 : 3};
}

void write_png(const std::string& path, const ImageU8& image) {
    write_text_file(path, with_context("writing " + path, [&] { return png_bytes(image); }));
}

ImageU8 resize_bicubic(const ImageU8& image, int width, int height) {
    if (width == image.width && height == image.height) return image;
    const int channels = image.channels;
    const Resampling across = cubic_resampling(image.width, width);
    const Resampling down = cubic_resampling(image.height, height);

    ImageF rows(width, image.height, channels);
    parallel_for_heavy(Cpu{}, image.height, [&](int y) {
        for (int x = 0; x < width; ++x) {
            const float* weights = &across.weights[static_cast<std::size_t>(x) * across.taps];
            for (int c = 0; c < channels; ++c) {
                float sum = 0;
                for (int j = 0; j < across.taps; ++j)
                    sum += weights[j] * image.at(across.first[x] + j, y, c);
                rows.at(x, y, c) = sum;
            }
        }
    });
    ImageU8 out(width, height, channels);
    parallel_for_heavy(Cpu{}, height, [&](int y) {
        std::vector<float> sums(static_cast<std::size_t>(width) * channels, 0.0f);
        for (int j = 0; j < down.taps; ++j) {
            const float weight = down.weights[static_cast<std::size_t>(y) * down.taps + j];
            const float* row = &rows.at(0, down.first[y] + j);
            for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += weight * row[i];
        }
        std::transform(sums.begin(), sums.end(), &out.at(0, y), to_byte);
    });
    return out;
}

ImageU8 resize_nearest(const ImageU8& image, int width, int height) {
    if (width == image.width && height == image.height) return image;
    ImageU8 out(width, height, image.channels);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            // The input pixel that contains the centre of the output pixel.
            const auto from_x =
                static_cast<int>((2 * std::int64_t{x} + 1) * image.width / (2 * width));
            const auto from_y =
                static_cast<int>((2 * std::int64_t{y} + 1) * image.height / (2 * height));
            for (int c = 0; c < image.channels; ++c) out.at(x, y, c) = image.at(from_x, from_y, c);
        }
    return out;
}

}  // namespace tvsgs
