#include "apps/priors/priors_folder.h"

#include <map>
#include <utility>

#include "core/error.h"
#include "core/log.h"
#include "io/atomic_file.h"
#include "io/manifest.h"
#include "io/npz.h"
#include "io/prior_sources.h"
#include "io/read_file.h"

namespace tvsgs::priors {
namespace {

namespace fs = std::filesystem;

const char* frame_name(NormalFrame frame) {
    return frame == NormalFrame::world           ? "world"
           : frame == NormalFrame::camera_opengl ? "camera_opengl"
                                                 : "camera_opencv";
}

bool is_ours(const fs::path& file) {
    const auto listing = folder_with_manifest(file);
    return listing && is_listed(*listing, file);
}

/// Without priors.json maps are found by their names; beside one they would not be.
void require_nothing_hidden(const fs::path& folder,
                            const std::string& scene,
                            const std::vector<std::string>& views) {
    std::error_code failure;
    if (!fs::is_directory(folder, failure)) return;
    const PriorSources found = find_priors({scene, fs::absolute(folder).string(), views});
    for (const PriorFiles* files :
         {static_cast<const PriorFiles*>(&found.depth),
          static_cast<const PriorFiles*>(&found.normal),
          static_cast<const PriorFiles*>(&found.confidence), &found.features, &found.sky})
        for (const auto& [view, file] : files->files)
            if (!is_ours(file.path))
                throw Error(ExitCode::usage,
                            str(folder.string(), ": holds maps that are found by their names, as ",
                                file.path, "; the priors.json of this command would hide them: ",
                                "name another folder with --out"));
}

}  // namespace

JsonValue section_of(const Recipe& recipe, const std::string& producer) {
    JsonValue section = JsonValue::object();
    section.set("dir", name_of(recipe.kind));
    section.set("encoding", "npy");
    if (recipe.kind == MapKind::depth) {
        if (recipe.quantity != PriorQuantity::unknown)
            section.set("quantity", tvsgs::name_of(recipe.quantity));
        if (recipe.geometry != PriorGeometry::unknown)
            section.set("geometry", tvsgs::name_of(recipe.geometry));
        section.set("alignment", tvsgs::name_of(recipe.alignment));
        section.set("invalid", std::vector<double>{0});
    } else if (recipe.kind == MapKind::normal) {
        if (recipe.frame) {
            section.set("frame", frame_name(*recipe.frame));
            section.set("facing", recipe.facing_away ? "away" : "camera");
        }
        section.set("layout", "hwc");
        section.set("range", "signed");
    } else {
        section.set("layout", "chw");
    }
    section.set("producer", producer);
    return section;
}

PriorsFolder::PriorsFolder(const std::string& folder,
                           MapKind kind,
                           JsonValue section,
                           bool overwrite,
                           const std::string& scene,
                           const std::vector<std::string>& views)
    : folder_(folder), kind_(kind), section_(std::move(section)), root_(JsonValue::object()) {
    std::map<fs::path, std::string> owner;
    for (const std::string& view : views)
        if (const auto [it, is_new] = owner.emplace(path_of(view), view); !is_new)
            throw input_error("E_PRIORS: ", it->second, " and ", view, ": both would have the map ",
                              it->first.string(), "; rename one of these photographs, or choose ",
                              "with --views");
    const fs::path json = folder_ / "priors.json";
    std::error_code failure;
    if (fs::exists(json, failure)) {
        require_replaceable(json);
        root_ = parse_json_value(read_text(json.string(), kMaxTextBytes), json.string());
        if (!root_.is(JsonValue::Kind::object))
            throw input_error("E_PRIORS: ", json.string(), ": is no JSON object");
    } else {
        require_nothing_hidden(folder_, scene, views);
    }
    const JsonValue& there = root_[name_of(kind)];
    const bool same = json_text(there) == json_text(section_);
    if (there && !same && !overwrite)
        throw Error(ExitCode::usage,
                    str(json.string(), ": has ", name_of(kind), " of '",
                        there["producer"].text_or("an unnamed program"),
                        "', and not as this run would write it, ", json_text(section_),
                        "; --overwrite replaces these maps, --out writes elsewhere"));
    continues_ = there && same && !overwrite;
    list_results(folder_, {name_of(kind), "priors.json"});
}

/// Readers take "_rgb" off the names of views.
fs::path PriorsFolder::path_of(const std::string& view) const {
    std::string stem = fs::path(view).replace_extension().string();
    if (stem.ends_with("_rgb")) stem.resize(stem.size() - 4);
    return folder_ / name_of(kind_) / (stem + ".npy");
}

bool PriorsFolder::has(const std::string& view) const {
    std::error_code failure;
    return continues_ && fs::is_regular_file(path_of(view), failure);
}

void PriorsFolder::write(const std::string& view, const ImageF& map) {
    if (!begun_ && !continues_) remove_replaced();
    const std::string path = path_of(view).string();
    if (kind_ == MapKind::depth) {
        write_npy(path, {map.height, map.width}, map.pixels.data());
    } else if (kind_ == MapKind::normal) {
        write_npy(path, {map.height, map.width, 3}, map.pixels.data());
    } else {
        const auto channels = static_cast<std::size_t>(map.channels);
        const std::size_t pixels = map.pixels.size() / channels;
        std::vector<float> planes(map.pixels.size());
        for (std::size_t i = 0; i < planes.size(); ++i)
            planes[i] = map.pixels[i % pixels * channels + i / pixels];
        write_npy(path, {map.channels, map.height, map.width}, planes.data());
    }
    if (!begun_) write_json();
    begun_ = true;
}

/// All of the folder is ours: the constructor has looked.
void PriorsFolder::remove_replaced() const {
    std::error_code failure;
    std::vector<fs::path> files;
    for (fs::recursive_directory_iterator it(folder_ / name_of(kind_), failure), end;
         !failure && it != end; it.increment(failure))
        if (it->is_regular_file(failure)) files.push_back(it->path());
    for (const fs::path& file : files) fs::remove(file, failure);
}

void PriorsFolder::write_json() const {
    JsonValue root = root_;
    // A confidence is that of the depth beside it.
    const bool other_depth = kind_ == MapKind::depth && root["depth"] && !continues_;
    if (other_depth && root["confidence"]) {
        spdlog::warn("{}: no longer has a confidence, which was that of the depth before",
                     (folder_ / "priors.json").string());
        std::erase_if(root.members, [](const auto& m) { return m.first == "confidence"; });
    }
    root.set(name_of(kind_), section_);
    std::string text = "{\n  \"version\": 1";
    for (const auto& [key, value] : root.members)
        if (key != "version") text += ",\n  " + json_text(JsonValue(key)) + ": " + json_text(value);
    write_text_file((folder_ / "priors.json").string(), text + "\n}\n");
}

}  // namespace tvsgs::priors
