#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "core/device/parallel.h"
#include "core/grouped.h"
#include "core/version.h"
#include "io/files/read_file.h"
#include "io/files/zip_archive.h"
#include "io/images/image_file.h"
#include "io/splats/codebook.h"
#include "io/splats/sog_math.h"
#include "io/splats/splat_checks.h"
#include "io/splats/splat_files.h"

namespace tvsgs {
namespace {

/// Prints floats as short as they can be.
using json = nlohmann::
    basic_json<std::map, std::vector, std::string, bool, std::int64_t, std::uint64_t, float>;

std::uint8_t* pixel(ImageU8& image, std::size_t i) {
    return &image.pixels[4 * i];
}

/// Two images with the low and the high bytes.
struct Means {
    ImageU8 low, high;
    Vec3f mins, maxs;
};

Means means_of(const Gaussians<Cpu>& g, const HalfTurn& turn, const ImageU8& blank) {
    constexpr float kMost = std::numeric_limits<float>::max();
    Means out{blank, blank, {kMost, kMost, kMost}, {-kMost, -kMost, -kMost}};
    for (const Vec3f mean : g.means.span())
        for (int c = 0; c < 3; ++c) {
            const auto t = static_cast<float>(sog::to_log(double{turn(mean)[c]}));
            out.mins[c] = std::min(out.mins[c], t), out.maxs[c] = std::max(out.maxs[c], t);
        }
    parallel_for(Cpu{}, g.size(), [&](std::size_t i) {
        const Vec3f p = turn(g.means[i]);
        for (int c = 0; c < 3; ++c) {
            const std::uint16_t u = sog::pack_position(sog::to_log(double{p[c]}),
                                                       double{out.mins[c]}, double{out.maxs[c]});
            pixel(out.low, i)[c] = static_cast<std::uint8_t>(u & 255);
            pixel(out.high, i)[c] = static_cast<std::uint8_t>(u >> 8);
        }
        pixel(out.low, i)[3] = pixel(out.high, i)[3] = 255;
    });
    return out;
}

/// Limit of base colours: eighteen times white or as far below black. One absurd value among
/// millions would otherwise spoil the codebook.
constexpr float kBrightest = 64;

/// Codebook of the values, clamped to [-most, most].
Codebook codebook_of(const Vec3f* values, std::size_t count, float most = INFINITY) {
    std::vector<float> all;
    all.reserve(3 * count);
    for (std::size_t i = 0; i < count; ++i)
        for (int c = 0; c < 3; ++c) all.push_back(std::clamp(values[i][c], -most, most));
    return make_codebook(std::move(all));
}

void put_codes(std::uint8_t* to, const Codebook& codes, Vec3f v) {
    for (int c = 0; c < 3; ++c) to[c] = nearest_code(codes, v[c]);
}

struct ShImages {
    ImageU8 labels, centroids;
    Codebook codes;
    int count = 0;
};

/// Palette size of PlayCanvas's tools: the largest power of two up to the number of splats, at most
/// 2^16.
int default_palette_size(std::size_t splats) {
    return static_cast<int>(
        std::min<std::size_t>(std::bit_floor(splats), std::size_t{sog::kMaxPalette}));
}

ShImages sh_images_of(const Gaussians<Cpu>& g,
                      const HalfTurn& turn,
                      int most,
                      const ImageU8& blank) {
    const std::size_t count = g.means.size();
    const int rest = sh_count(g.sh_degree) - 1;
    std::vector<float> vectors(3 * rest * count);
    parallel_for(Cpu{}, g.size(), [&](std::size_t i) {
        for (int k = 0; k < rest; ++k)
            for (int c = 0; c < 3; ++c)
                vectors[3 * (i * rest + k) + c] =
                    turn.of_coefficient(k + 1) * g.sh[(k + 1) * count + i][c];
    });
    const ShPalette palette = make_sh_palette(vectors, 3 * rest, most);
    ShImages out{blank, {}, make_codebook(palette.centres), palette.count};
    parallel_for(Cpu{}, g.size(), [&](std::size_t i) {
        std::uint8_t* const to = pixel(out.labels, i);
        to[0] = static_cast<std::uint8_t>(palette.labels[i] & 255);
        to[1] = static_cast<std::uint8_t>(palette.labels[i] >> 8);
        to[2] = 0, to[3] = 255;
    });
    constexpr int kColumns = sog::kPaletteColumns;
    out.centroids = ImageU8(kColumns * rest, (palette.count + kColumns - 1) / kColumns, 4, 255);
    for (std::size_t at = 0; at < std::size_t(palette.count) * rest; ++at)
        for (int c = 0; c < 3; ++c)  // pixel: centroid at / rest, coefficient at % rest
            out.centroids.pixels[4 * at + c] = nearest_code(out.codes, palette.centres[3 * at + c]);
    return out;
}

}  // namespace

std::string sog_bytes(const std::string& path,
                      const Gaussians<Cpu>& g,
                      const SplatFileOptions& options) {
    require_writable(g, path);
    const std::size_t count = g.means.size();
    if (count == 0) throw input_error(path, ": not written: no splats");
    const int width = 4 * static_cast<int>(std::ceil(std::sqrt(double(count)) / 4)),
              height = 4 * static_cast<int>(std::ceil(double(count) / width / 4));
    if (width > kWebpMaxSide)
        throw input_error(path, ": not written: ", grouped(count), " splats: too many (limit ",
                          grouped(16380 * 16380), "); keep fewer with --max-splats");
    const HalfTurn turn = half_turn(options.frame.value_or(SplatFrame::rdf));
    const ImageU8 blank(width, height, 4);
    json meta{{"version", sog::kVersion}, {"asset", {{"generator", kVersion}}}, {"count", count}};
    if (options.antialiased) meta["model"] = "antialiased";
    std::vector<std::pair<std::string, std::string>> files{{sog::kMetaName, ""}};
    const auto add = [&](json& list, const char* name, const ImageU8& image) {
        list.push_back(name);
        files.emplace_back(name, webp_lossless_bytes(image));
    };

    const Means means = means_of(g, turn, blank);
    meta["means"] = {{"mins", {means.mins.x, means.mins.y, means.mins.z}},
                     {"maxs", {means.maxs.x, means.maxs.y, means.maxs.z}}};
    add(meta["means"]["files"], "means_l.webp", means.low);
    add(meta["means"]["files"], "means_u.webp", means.high);

    const Codebook scale_codes = codebook_of(g.log_scales.data(), count),
                   color_codes = codebook_of(g.sh.data(), count, kBrightest);
    ImageU8 scales = blank, quats = blank, colors = blank;
    parallel_for(Cpu{}, g.size(), [&](std::size_t i) {
        put_codes(pixel(scales, i), scale_codes, g.log_scales[i]);
        pixel(scales, i)[3] = 255;
        const auto quat = sog::pack_quat(turn(g.quats[i]));
        std::copy(quat.begin(), quat.end(), pixel(quats, i));
        put_codes(pixel(colors, i), color_codes, g.sh[i]);
        pixel(colors, i)[3] =
            static_cast<std::uint8_t>(std::round(255 * sigmoid(g.opacity_logits[i])));
    });
    meta["scales"]["codebook"] = scale_codes;
    add(meta["scales"]["files"], "scales.webp", scales);
    add(meta["quats"]["files"], "quats.webp", quats);
    meta["sh0"]["codebook"] = color_codes;
    add(meta["sh0"]["files"], "sh0.webp", colors);
    if (g.sh_degree > 0) {
        const int usual = default_palette_size(count);
        const ShImages sh = sh_images_of(
            g, turn, options.sog_palette > 0 ? std::min(options.sog_palette, usual) : usual, blank);
        meta["shN"] = {{"count", sh.count}, {"bands", g.sh_degree}, {"codebook", sh.codes}};
        add(meta["shN"]["files"], "shN_centroids.webp", sh.centroids);
        add(meta["shN"]["files"], "shN_labels.webp", sh.labels);
    }
    files[0].second = meta.dump();  // first, because it identifies the writer
    return zip_bytes(files);
}

}  // namespace tvsgs
