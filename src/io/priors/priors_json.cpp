// Reads priors.json, and depth conventions from files of 3DGS and nerfstudio.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <initializer_list>

#include "core/math/quantile.h"
#include "io/files/json_value.h"
#include "io/files/read_file.h"
#include "io/priors/prior_sources.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using Kind = JsonValue::Kind;

/// A JSON file. Each error names the file and the place in it.
struct Document {
    std::string path;
    JsonValue root;

    explicit Document(const std::string& p)
        : path(p), root(parse_json_value(read_text(p, kMaxTextBytes), p)) {
        if (!root.is(Kind::object)) throw wrong("", "not a JSON object");
    }
    template <class... Parts>
    Error wrong(const std::string& where, const Parts&... what) const {
        return input_error("E_PRIORS: ", path, ": ", where.empty() ? "" : where + ": ", what...);
    }
    void allow(const std::string& where,
               const JsonValue& object,
               std::initializer_list<std::string_view> keys) const {
        for (const auto& [key, value] : object.members)
            if (std::ranges::find(keys, key) == keys.end())
                throw wrong(where, "unknown key '", shown(key), "'; expected one of ",
                            joined(keys));
    }
    /// Index in `words` of the member's text; `fallback` if there is no member.
    int choice(const std::string& where,
               const JsonValue& object,
               std::string_view key,
               std::initializer_list<std::string_view> words,
               int fallback) const {
        const JsonValue& value = object[key];
        if (!value) return fallback;
        const auto at = std::ranges::find(words, value.text);
        if (value.is(Kind::text) && at != words.end()) return static_cast<int>(at - words.begin());
        throw wrong(where, key, " is '", shown(value.text), "'; expected ", joined(words));
    }
    double number(const std::string& where,
                  const JsonValue& object,
                  std::string_view key,
                  double fallback) const {
        const JsonValue& value = object[key];
        if (value && !(value.is(Kind::number) && std::isfinite(value.number)))
            throw wrong(where, key, " is not a number");
        return value.number_or(fallback);
    }
    /// Numbers of a list; empty if there is no member.
    std::vector<double> numbers(const std::string& where,
                                const JsonValue& object,
                                std::string_view key) const {
        std::vector<double> values;
        const JsonValue& list = object[key];
        bool fits = !list || list.is(Kind::list);
        for (const JsonValue& item : list.items) {
            fits = fits && item.is(Kind::number);
            values.push_back(item.number);
        }
        if (!fits) throw wrong(where, key, " is not a list of numbers");
        return values;
    }
    /// Path of a folder or file beside the document.
    std::string beside(const std::string& where, const std::string& name) const {
        const fs::path clean = fs::path(name).lexically_normal();
        if (name.empty() || name.size() > 4096 || clean.is_absolute() ||
            clean.generic_string().starts_with(".."))
            throw wrong(where, "'", shown(name), "'; expected a relative path without '..'");
        return (fs::path(path).parent_path() / clean).string();
    }
};

/// Reads "dir" and "encoding" of a kind and lists its files.
PriorFiles listed_files(const Document& in,
                        const std::string& kind,
                        const std::vector<std::string>& views) {
    const JsonValue& object = in.root[kind];
    if (!object) return {};
    if (!object.is(Kind::object)) throw in.wrong(kind, "not a JSON object");
    const std::string folder = in.beside(kind, object["dir"].text_or(kind));
    const std::string encoding = object["encoding"].text_or(kind == "sky" ? "png8" : "npy");
    std::string ending = encoding;
    if (encoding == "png8" || encoding == "png16") ending = "png";
    if (encoding == "exr")
        throw in.wrong(kind, "encoding exr is unknown; convert the maps to npy or pfm");
    if (ending != "png" && ending != "npy" && ending != "pfm" && ending != "dmb" &&
        ending != "colmap")
        throw in.wrong(kind, "encoding is '", shown(encoding),
                       "'; expected npy, pfm, png8, png16, colmap or dmb");
    PriorFiles files =
        ending == "colmap"
            ? match_priors(folder, {".geometric.bin", ".photometric.bin"}, views, true)
            : match_priors(folder, {"." + ending}, views);
    if (ending == "colmap" && files.empty()) files = match_priors(folder, {".bin"}, views);
    if (files.empty())
        throw in.wrong(kind, folder, " has no file of that encoding for the ", views.size(),
                       " views; expected names such as ",
                       views.empty() ? "0001" : fs::path(views[0]).stem().string(), ".",
                       ending == "colmap" ? "png.geometric.bin" : ending);
    const int layout = in.choice(kind, object, "layout", {"hwc", "chw"}, -1);
    files.layout = layout < 0    ? MapLayout::automatic
                   : layout == 0 ? MapLayout::hwc
                                 : MapLayout::chw;
    return files;
}

void read_per_image(const Document& in, DepthSource& depth) {
    const JsonValue& object = in.root["depth"]["per_image"];
    const double unit = in.number("depth", in.root["depth"], "png_scale", 1);
    for (auto& [view, file] : depth.files) {
        file.scale = unit;
        const JsonValue& own = object[fs::path(view).replace_extension().generic_string()];
        const std::string where = str("depth: per_image: ", shown(view));
        if (!own) continue;
        if (!own.is(Kind::object)) throw in.wrong(where, "not a JSON object");
        in.allow(where, own, {"scale", "shift", "crop"});
        file.scale *= in.number(where, own, "scale", 1);
        file.shift = in.number(where, own, "shift", 0);
        const std::vector<double> crop = in.numbers(where, own, "crop");
        if (crop.empty()) continue;
        if (crop.size() != 4 || !(crop[0] >= 0 && crop[1] >= 0 && crop[2] >= 1 && crop[3] >= 1))
            throw in.wrong(where, "crop is not [x, y, width, height] in pixels");
        file.window = {crop[0], crop[1], crop[2], crop[3]};
    }
}

DepthSource listed_depth(const Document& in, const std::vector<std::string>& views) {
    DepthSource depth;
    static_cast<PriorFiles&>(depth) = listed_files(in, "depth", views);
    if (depth.empty()) return depth;
    const JsonValue& object = in.root["depth"];
    in.allow("depth", object,
             {"dir", "encoding", "quantity", "geometry", "alignment", "png_scale", "invalid",
              "producer", "per_image", "layout"});
    DepthConvention& c = depth.convention;
    c.quantity = static_cast<PriorQuantity>(
        1 + in.choice("depth", object, "quantity", {"depth", "inverse_depth", "log_depth"}, -1));
    c.geometry =
        static_cast<PriorGeometry>(1 + in.choice("depth", object, "geometry", {"z", "ray"}, -1));
    c.alignment = static_cast<PriorAlignment>(in.choice("depth", object, "alignment",
                                                        {"metric", "scale", "affine", "rank"},
                                                        static_cast<int>(PriorAlignment::affine)));
    if (c.quantity != PriorQuantity::unknown || c.geometry != PriorGeometry::unknown ||
        object["alignment"])
        c.declared_by = in.path;
    depth.invalid =
        object["invalid"] ? in.numbers("depth", object, "invalid") : std::vector<double>{0};
    if (const std::string by = object["producer"].text_or(""); !by.empty())
        depth.what += str(", ", shown(by));
    read_per_image(in, depth);
    return depth;
}

}  // namespace

PriorSources read_priors_json(const std::string& folder, const std::vector<std::string>& views) {
    const Document in((fs::path(folder) / "priors.json").string());
    in.allow("", in.root, {"version", "depth", "confidence", "normal", "features", "sky", "pairs"});
    if (const double version = in.number("", in.root, "version", 1); version != 1)
        throw in.wrong("", "version is ", version, "; expected 1");
    PriorSources found;
    found.depth = listed_depth(in, views);

    static_cast<PriorFiles&>(found.confidence) = listed_files(in, "confidence", views);
    in.allow("confidence", in.root["confidence"], {"dir", "encoding", "range", "producer"});
    found.confidence.from_one =
        in.choice("confidence", in.root["confidence"], "range", {"unit", "ge1"}, 0) == 1;

    static_cast<PriorFiles&>(found.normal) = listed_files(in, "normal", views);
    const JsonValue& normal = in.root["normal"];
    in.allow("normal", normal,
             {"dir", "encoding", "frame", "facing", "layout", "range", "producer"});
    NormalConvention& c = found.normal.convention;
    c.frame = static_cast<NormalFrame>(
        in.choice("normal", normal, "frame", {"camera_opencv", "camera_opengl", "world"}, 0));
    c.facing_away = in.choice("normal", normal, "facing", {"camera", "away"}, 0) == 1;
    if (normal["frame"] || normal["facing"]) c.declared_by = in.path;
    found.normal.range =
        static_cast<NumberRange>(1 + in.choice("normal", normal, "range", {"unit", "signed"}, -1));

    found.features = listed_files(in, "features", views);
    in.allow("features", in.root["features"],
             {"dir", "encoding", "layout", "stride", "l2_normalised", "producer"});
    found.sky = listed_files(in, "sky", views);
    in.allow("sky", in.root["sky"], {"dir", "encoding", "producer"});
    return found;
}

void read_depth_params(const std::string& path, DepthSource& source) {
    const Document in(path);
    std::vector<double> scales;
    for (auto& [view, file] : source.files) {
        const JsonValue& own = in.root[fs::path(view).replace_extension().generic_string()];
        if (!own.is(Kind::object))
            throw in.wrong("", "no entry for image '", shown(view),
                           "', which has a depth map; make the file again for all images");
        const std::string where = shown(view);
        file.scale = in.number(where, own, "scale", 0);
        file.shift = in.number(where, own, "offset", 0);
        if (file.scale > 0) scales.push_back(file.scale);
    }
    const double median = scales.empty() ? 0 : middle_of(scales);
    for (auto& [view, file] : source.files) {
        // As in 3DGS: a scale far from the median comes from a bad fit.
        file.unreliable = !(file.scale > 0.2 * median && file.scale < 5 * median);
        file.scale = (file.unreliable ? 1 : file.scale) / 65536;
        if (file.unreliable) file.shift = 0;
    }
}

DepthSource read_transforms_depth(const std::string& folder,
                                  const std::vector<std::string>& views) {
    const fs::path path = fs::path(folder) / "transforms.json";
    if (!is_file(path)) return {};
    const Document in(path.string());
    const double unit = in.number("", in.root, "depth_unit_scale_factor", 1e-3);
    std::map<std::string, std::string> by_image, by_last;
    for (const JsonValue& frame : in.root["frames"].items) {
        const std::string image = frame["file_path"].text_or(""),
                          depth = frame["depth_file_path"].text_or("");
        if (depth.empty()) continue;
        const std::string file = in.beside("depth_file_path", depth);
        if (!is_file(file)) continue;
        fs::path name = fs::path(image).lexically_normal().replace_extension();
        by_image[name.generic_string()] = file;
        by_last[name.filename().string()] = file;
    }
    DepthSource source;
    for (const std::string& view : views) {
        const fs::path name = fs::path(view).replace_extension();
        auto at = by_image.find(name.generic_string());
        if (at == by_image.end() && by_last.size() == by_image.size()) {
            at = by_last.find(name.filename().string());
            if (at == by_last.end()) continue;
        }
        if (at == by_image.end()) continue;
        source.files[view] = {at->second, unit, 0, {}, false};
    }
    if (source.empty()) return source;
    source.what = "transforms.json depth_file_path";
    source.convention = {PriorQuantity::depth, PriorGeometry::unknown, PriorAlignment::metric, ""};
    source.invalid = {0};
    return source;
}

}  // namespace tvsgs
