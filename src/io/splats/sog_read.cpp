#include <algorithm>
#include <filesystem>
#include <map>

#include "core/device/parallel.h"
#include "io/files/json_value.h"
#include "io/files/read_file.h"
#include "io/files/zip_archive.h"
#include "io/images/image_file.h"
#include "io/splats/codebook.h"
#include "io/splats/sog_math.h"
#include "io/splats/splat_checks.h"
#include "io/splats/splat_files.h"

namespace tvsgs {
namespace {

constexpr std::int64_t kMaxSplats = 50000000;
// Images of a single colour compress to almost nothing, also in the archive. So the size of the
// file limits the number of splats and bytes that it may claim.
constexpr std::int64_t kSplatsPerByte = 16;
constexpr std::uint64_t kInflated = 16, kAtLeast = 1 << 20;  // per byte; at least
constexpr std::size_t kMaxMeta = 1 << 20;                    // bytes; most of it are codebooks

class SogReader {
public:
    explicit SogReader(const std::string& path) : path_(path) {
        std::error_code no_file;  // read_zip() reports it
        const std::uintmax_t size = std::filesystem::file_size(path, no_file);
        const std::uint64_t bytes = no_file ? 0 : size;
        read_zip(path, "SOG", {.entries = 64, .total_bytes = kInflated * bytes + kAtLeast},
                 [&](const std::string& name, std::string content) {
                     files_[name] = std::move(content);
                 });
        const auto found = files_.find(sog::kMetaName);
        if (found == files_.end()) fail("no ", sog::kMetaName, "; is it a SOG file?");
        if (found->second.size() > kMaxMeta) fail(sog::kMetaName, " is larger than 1 MiB");
        meta_ = parse_json_value(found->second, where_of(sog::kMetaName));
        if (!meta_.is(JsonValue::Kind::object)) fail(sog::kMetaName, " is damaged");
        if (const std::int64_t version = whole(meta_, "version", 1); version != sog::kVersion)
            fail("SOG version ", version, "; expected ", sog::kVersion);
        count_ = whole(meta_, "count", 0);
        const std::int64_t most =
            std::min(kMaxSplats, kSplatsPerByte * static_cast<std::int64_t>(bytes));
        if (count_ < 1 || count_ > most)
            fail("claims ", count_, " splats; expected 1 to ", most, " in a file of its size");
    }

    Gaussians<Cpu> read(const HalfTurn& turn) {
        Gaussians<Cpu> g;
        const JsonValue& rest = meta_["shN"];
        const std::int64_t bands = whole(rest, "bands", 0);
        if (bands < 0 || bands > 3 || (bands == 0 && rest))
            fail("shN: ", bands, " bands; expected 1 to 3");
        // Allocates only for splats that have pixels in all images.
        encoded(meta_["means"], 1, count_);
        for (const char* part : {"means", "scales", "sh0", "quats"})
            encoded(meta_[part], 0, count_);
        if (bands > 0) encoded(rest, 1, count_);
        resize(g, static_cast<int>(count_), static_cast<int>(bands));
        read_means(g, turn);
        read_others(g, turn);
        if (bands > 0) read_sh(g, rest, turn);
        require_valid(g, path_);
        return g;
    }

private:
    template <class... Parts>
    [[noreturn]] void fail(const Parts&... parts) const {
        throw input_error(path_, ": ", parts...);
    }
    std::int64_t whole(const JsonValue& object, const char* key, std::int64_t standard) const {
        const JsonValue& found = object[key];
        if (!found) return standard;
        const double number = found.number_or(-1);
        if (!(number >= 0 && number <= std::exp2(40)) || number != std::floor(number))
            fail("\"", key, "\" is not a plausible whole number");
        return static_cast<std::int64_t>(number);
    }
    std::vector<float> numbers(const JsonValue& object, const char* key, std::size_t count) const {
        std::vector<float> out;
        for (const JsonValue& item : object[key].items)
            out.push_back(static_cast<float>(item.number_or(NAN)));
        if (out.size() != count ||
            !std::ranges::all_of(out, [](float v) { return std::isfinite(v); }))
            fail("\"", key, "\": expected ", count, " finite numbers");
        return out;
    }
    Codebook codebook(const JsonValue& object) const {
        const std::vector<float> values = numbers(object, "codebook", Codebook{}.size());
        Codebook codes;
        std::copy(values.begin(), values.end(), codes.begin());
        return codes;
    }
    /// The file of image `at` of a part. Its first bytes must show at least `least` pixels.
    const std::pair<const std::string, std::string>& encoded(const JsonValue& part,
                                                             std::size_t at,
                                                             std::int64_t least) const {
        const std::vector<JsonValue>& names = part["files"].items;
        if (at >= names.size() || !names[at].is(JsonValue::Kind::text))
            fail("a list of files is missing or too short");
        const auto found = files_.find(names[at].text);
        if (found == files_.end()) fail("its file ", shown(names[at].text), " is missing");
        const std::string where = where_of(found->first);
        const std::optional<ImageSize> size = webp_size(found->second);
        if (!size) throw input_error(where, ": not a WebP picture");
        if (std::int64_t{size->width} * size->height < least)
            throw input_error(where, ": ", size->width, "x", size->height,
                              " pixels; expected at least ", least);
        return *found;
    }
    std::string where_of(const std::string& name) const { return str(path_, ": ", shown(name)); }
    ImageU8 picture(const JsonValue& part, std::size_t at, std::int64_t least) const {
        const auto& [name, bytes] = encoded(part, at, least);
        return decode_image(where_of(name), bytes, 4, 2 * least + (1 << 16));
    }

    void read_means(Gaussians<Cpu>& g, const HalfTurn& turn) const {
        const JsonValue& part = meta_["means"];
        const std::vector<float> mins = numbers(part, "mins", 3), maxs = numbers(part, "maxs", 3);
        const ImageU8 low = picture(part, 0, count_), high = picture(part, 1, count_);
        parallel_for(Cpu{}, g.size(), [&](std::size_t i) {
            Vec3f p;
            for (int c = 0; c < 3; ++c)
                p[c] = static_cast<float>(
                    sog::unpack_position(low.pixels[4 * i + c] | high.pixels[4 * i + c] << 8,
                                         double{mins[c]}, double{maxs[c]}));
            g.means[i] = turn(p);
        });
    }

    void read_others(Gaussians<Cpu>& g, const HalfTurn& turn) const {
        const JsonValue &scales = meta_["scales"], &colors = meta_["sh0"];
        const Codebook scale_codes = codebook(scales), color_codes = codebook(colors);
        const ImageU8 scale = picture(scales, 0, count_), color = picture(colors, 0, count_),
                      quat = picture(meta_["quats"], 0, count_);
        parallel_for(Cpu{}, g.size(), [&](std::size_t i) {
            for (int c = 0; c < 3; ++c) {
                g.log_scales[i][c] = scale_codes[scale.pixels[4 * i + c]];
                g.sh[i][c] = color_codes[color.pixels[4 * i + c]];
            }
            g.opacity_logits[i] = logit(static_cast<float>(color.pixels[4 * i + 3]) / 255);
            g.quats[i] = turn(sog::unpack_quat(&quat.pixels[4 * i]));
        });
    }

    void read_sh(Gaussians<Cpu>& g, const JsonValue& part, const HalfTurn& turn) const {
        const std::int64_t palette = whole(part, "count", 0);
        if (palette < 1 || palette > sog::kMaxPalette)
            fail("shN: a palette of ", palette, "; expected 1 to ", sog::kMaxPalette);
        const Codebook codes = codebook(part);
        const int rest = sh_count(g.sh_degree) - 1;
        constexpr int kColumns = sog::kPaletteColumns;
        const std::int64_t rows = (palette + kColumns - 1) / kColumns;
        const ImageU8 centroids = picture(part, 0, rows * kColumns * rest);
        if (centroids.width != kColumns * rest)
            fail("shN: centroids in a picture ", centroids.width, " wide; expected ",
                 kColumns * rest);
        const ImageU8 labels = picture(part, 1, count_);
        const auto count = static_cast<std::size_t>(count_);
        parallel_for(Cpu{}, g.size(), [&](std::size_t i) {
            const std::size_t label =
                std::min<std::size_t>(labels.pixels[4 * i] + 256u * labels.pixels[4 * i + 1],
                                      static_cast<std::size_t>(palette) - 1);
            for (int k = 0; k < rest; ++k)
                for (int c = 0; c < 3; ++c)
                    g.sh[(k + 1) * count + i][c] =
                        turn.of_coefficient(k + 1) *
                        codes[centroids.pixels[4 * (label * rest + k) + c]];
        });
    }

    const std::string& path_;
    std::map<std::string, std::string> files_;
    JsonValue meta_;
    std::int64_t count_ = 0;
};

}  // namespace

Gaussians<Cpu> read_sog(const std::string& path, SplatFrame frame) {
    return SogReader(path).read(half_turn(frame));
}

}  // namespace tvsgs
