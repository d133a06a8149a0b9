#include "io/splats/splat_files.h"

#include <filesystem>

#include "core/error.h"
#include "core/version.h"
#include "io/files/atomic_file.h"
#include "io/files/json_value.h"
#include "io/files/manifest.h"
#include "io/files/read_file.h"
#include "io/splats/ply.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

SplatFormat format_of(const std::string& path) {
    const std::optional<SplatFormat> format = splat_format(path);
    if (!format)
        throw Error(ExitCode::usage, path,
                    ": unknown ending; expected splats in .ply, .spz, .sog or .glb");
    return *format;
}

/// Origin in the scene's axes: added to a position after its rotation from the file's frame.
std::string origin_json(const SplatFileOptions& options, SplatFrame frame) {
    const Vec3d o = options.origin;
    JsonValue json;
    json.add("generator", kVersion)
        .add("frame", info_of(frame).name)
        .add("origin", std::vector{o.x, o.y, o.z});
    if (!options.projection.empty()) json.add("projection", options.projection);
    return json_text(json) + "\n";
}

/// Content of FILE.json if tvsgs wrote it, else nothing.
std::optional<JsonValue> read_origin_file(const std::string& path) {
    const std::string file = origin_file(path);
    if (!is_file(file)) return {};
    JsonValue json = parse_json_value(read_text(file), file);
    if (!json["generator"].text_or("").starts_with("tvsgs ")) return {};
    return json;
}

Vec3d origin_in(const JsonValue& json, const std::string& path) {
    const Vec3d origin = vector_of(json["origin"]);
    if (!is_finite(origin))
        throw input_error(origin_file(path), ": \"origin\": expected three finite numbers");
    return origin;
}

/// Call it before writing the splats: an older origin would move them.
void put_origin_file(const std::string& path, const SplatFileOptions& options, SplatFrame frame) {
    require_replaceable(path);
    if (norm(options.origin) > 0 || !options.projection.empty())
        write_text_file(origin_file(path), origin_json(options, frame));
    else if (read_origin_file(path))
        fs::remove(origin_file(path));
}

}  // namespace

std::optional<SplatFormat> splat_format(const std::string& path) {
    const std::string extension = lower_case(fs::path(path).extension().string());
    if (extension == ".ply") return SplatFormat::ply;
    if (extension == ".spz") return SplatFormat::spz;
    if (extension == ".sog") return SplatFormat::sog;
    if (extension == ".glb") return SplatFormat::glb;
    return std::nullopt;
}

std::string origin_file(const std::string& path) {
    return path + ".json";
}

std::uintmax_t write_splat_file(const std::string& path,
                                const Gaussians<Cpu>& g,
                                const SplatFileOptions& options) {
    const SplatFormat format = format_of(path);
    const SplatFrame frame = options.frame.value_or(default_frame(format));
    if (format == SplatFormat::ply) {
        Gaussians<Cpu> turned;
        copy(g, turned);
        turn(turned, half_turn(frame));
        const Vec3f signs = half_turn(frame).signs;
        write_splat_ply(path, turned, vec_cast<double>(signs) * options.origin, PlyScales::three,
                        /*signature=*/true, options.projection);
        return fs::file_size(path);
    }
    std::string bytes;
    if (format == SplatFormat::glb) {
        bytes = splat_glb_bytes(path, g, options);
    } else {
        if (format == SplatFormat::spz) {
            const std::vector<std::uint8_t> packed = spz_bytes(g, options, path);
            bytes.assign(packed.begin(), packed.end());
        } else {
            bytes = sog_bytes(path, g, options);
        }
        put_origin_file(path, options, frame);
    }
    write_text_file(path, bytes);
    return bytes.size();
}

Georeference read_splat_place(const std::string& path) {
    const SplatFormat format = format_of(path);
    if (format == SplatFormat::ply) return {};
    Georeference place;
    if (format == SplatFormat::glb)
        place = splat_glb_place(read_bytes(path), path);
    else if (const std::optional<JsonValue> json = read_origin_file(path))
        place = {(*json)["projection"].text_or(""), origin_in(*json, path)};
    if (!is_one_line(place.projection))
        throw input_error(path, ": \"projection\": expected one line of text");
    return place;
}

Gaussians<Cpu> read_splat_file(const std::string& path,
                               std::optional<SplatFrame> given,
                               Vec3d origin) {
    const SplatFormat format = format_of(path);
    const SplatFrame frame = given.value_or(default_frame(format));
    switch (format) {
        case SplatFormat::spz:
            return read_spz(path, frame).splats;
        case SplatFormat::sog:
            return read_sog(path, frame);
        case SplatFormat::glb:
            return parse_splat_glb(read_bytes(path), path, frame);
        default: {
            const HalfTurn by = half_turn(frame);
            Gaussians<Cpu> g = read_splat_ply(path, vec_cast<double>(by.signs) * origin);
            turn(g, by);
            return g;
        }
    }
}

}  // namespace tvsgs
