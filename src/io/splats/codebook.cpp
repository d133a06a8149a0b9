#include "io/splats/codebook.h"

#include <algorithm>
#include <cmath>

namespace tvsgs {
namespace {

/// Centres whose density follows the cube root of the density of `values` (sorted). This is optimal
/// for many codes and a good start for Lloyd's algorithm.  [Gersho and Gray, Vector Quantization,
/// 5.6]
std::array<double, Codebook{}.size()> first_centres(const std::vector<float>& values) {
    std::array<double, Codebook{}.size()> centres;
    const std::size_t last = values.size() - 1, parts = std::min<std::size_t>(last, 4096);
    const auto edge = [&](std::size_t part) { return double{values[part * last / parts]}; };
    std::vector<double> codes(parts + 1, 0);  // cumulative, not normalised
    for (std::size_t i = 0; i < parts; ++i)
        codes[i + 1] = codes[i] + std::pow(edge(i + 1) - edge(i), 2.0 / 3);
    std::size_t part = 0;
    for (std::size_t c = 0; c < centres.size(); ++c) {
        const double wanted =
            (static_cast<double>(c) + 0.5) / static_cast<double>(centres.size()) * codes[parts];
        while (part + 1 < parts && codes[part + 1] < wanted) ++part;
        const double width = codes[part + 1] - codes[part];
        const double within = width > 0 ? (wanted - codes[part]) / width : 0;
        centres[c] = edge(part) + within * (edge(part + 1) - edge(part));
    }
    return centres;
}

}  // namespace

Codebook make_codebook(std::vector<float> values) {
    Codebook codes{};
    constexpr std::size_t kCodes = codes.size(), kSample = std::size_t{1} << 20;
    if (values.empty()) return codes;
    if (const std::size_t stride = (values.size() + kSample - 1) / kSample; stride > 1) {
        for (std::size_t i = 0; i * stride < values.size(); ++i) values[i] = values[i * stride];
        values.resize((values.size() + stride - 1) / stride);
    }
    std::sort(values.begin(), values.end());
    std::vector<float> different;
    for (const float v : values) {
        if (different.empty() || v != different.back()) different.push_back(v);
        if (different.size() > kCodes) break;
    }
    if (different.size() <= kCodes) {
        for (std::size_t c = 0; c < kCodes; ++c)
            codes[c] = different[std::min(c, different.size() - 1)];
        return codes;
    }
    const std::size_t count = values.size();
    std::vector<double> sums(count + 1, 0);  // prefix sums: the sum of a cell is a difference
    for (std::size_t i = 0; i < count; ++i) sums[i + 1] = sums[i] + double{values[i]};
    std::array<double, kCodes> centres = first_centres(values);
    constexpr int kSteps = 100;  // a step takes microseconds
    for (int step = 0; step < kSteps; ++step) {
        bool moved = false;
        std::size_t begin = 0;
        for (std::size_t c = 0; c < kCodes; ++c) {
            std::size_t end = count;
            if (c + 1 < kCodes) {
                const double border = (centres[c] + centres[c + 1]) / 2;
                end = static_cast<std::size_t>(
                    std::upper_bound(values.begin() + static_cast<std::ptrdiff_t>(begin),
                                     values.end(), border,
                                     [](double b, float v) { return b < double{v}; }) -
                    values.begin());
            }
            if (end > begin) {
                const double mean = (sums[end] - sums[begin]) / static_cast<double>(end - begin);
                moved = moved || mean != centres[c];
                centres[c] = mean;
            }
            begin = end;
        }
        if (!moved) break;
    }
    std::sort(centres.begin(), centres.end());
    std::transform(centres.begin(), centres.end(), codes.begin(),
                   [](double v) { return static_cast<float>(v); });
    return codes;
}

std::uint8_t nearest_code(const Codebook& codes, float value) {
    const auto above = std::lower_bound(codes.begin(), codes.end(), value);
    if (above == codes.begin()) return 0;
    const auto at = above - codes.begin();
    const bool lower = above == codes.end() || value - above[-1] <= above[0] - value;
    return static_cast<std::uint8_t>(lower ? at - 1 : at);
}

}  // namespace tvsgs
