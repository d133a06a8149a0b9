#include <algorithm>
#include <cmath>

#include "eval/benchmark_files.h"
#include "io/images/image_file.h"
#include "report/page_data.h"

namespace tvsgs {
namespace {

constexpr double kFullDifference = 0.25;

std::uint8_t byte_of(double value) {
    return static_cast<std::uint8_t>(std::clamp(std::lround(255 * value), 0L, 255L));
}

Rgb cividis(double share) {
    const Vec3f c = error_color(ErrorPalette::safe, share, 1, PointStatus::measured);
    return {byte_of(static_cast<double>(c.x)), byte_of(static_cast<double>(c.y)),
            byte_of(static_cast<double>(c.z))};
}

}  // namespace

std::string base64(const std::string& bytes) {
    static const char* const digits =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string out;
    out.reserve(bytes.size() / 3 * 4 + 4);
    for (std::size_t i = 0; i < bytes.size(); i += 3) {
        const auto at = [&](std::size_t j) {
            return j < bytes.size() ? static_cast<unsigned char>(bytes[j]) : 0u;
        };
        const unsigned bits = at(i) << 16 | at(i + 1) << 8 | at(i + 2);
        out += digits[bits >> 18];
        out += digits[bits >> 12 & 63];
        out += i + 1 < bytes.size() ? digits[bits >> 6 & 63] : '=';
        out += i + 2 < bytes.size() ? digits[bits & 63] : '=';
    }
    return out;
}

JsonValue picture_json(const ImageU8& image, int width) {
    const int w = std::min(width, image.width);
    const int h = std::max(
        1, static_cast<int>(std::lround(static_cast<double>(image.height) * w / image.width)));
    const std::string jpeg = jpeg_bytes(resize_bicubic(image, w, h), 85);
    return JsonValue()
        .add("src", "data:image/jpeg;base64," + base64(jpeg))
        .add("width", w)
        .add("height", h);
}

Rgb error_shade(double share) {
    return cividis(0.2 + 0.8 * std::clamp(share, 0.0, 1.0));
}

ImageU8 difference_image(const ImageU8& a, const ImageU8& b) {
    ImageU8 out(a.width, a.height, 3);
    for (int y = 0; y < a.height; ++y)
        for (int x = 0; x < a.width; ++x) {
            int sum = 0;
            for (int c = 0; c < 3; ++c) sum += std::abs(a.at(x, y, c) - b.at(x, y, c));
            const Rgb shade = cividis(sum / (3 * 255 * kFullDifference));
            out.at(x, y, 0) = shade.r, out.at(x, y, 1) = shade.g, out.at(x, y, 2) = shade.b;
        }
    return out;
}

double full_error(const Truth& truth) {
    double full = 0;
    for (const double tau : truth.taus) full = std::max(full, 2 * tau);
    return full;
}

}  // namespace tvsgs
