// Recognises prior files of other programs by their names, and assigns files to views.
#include <filesystem>
#include <set>
#include <utility>

#include "io/files/read_file.h"
#include "io/priors/prior_sources.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using Strings = std::vector<std::string>;

/// Map that forgets keys with several different values.
class UniqueMap {
public:
    void add(const std::string& key, const std::string& value) {
        if (const auto [at, is_new] = values_.emplace(key, value); !is_new && at->second != value)
            ambiguous_.insert(key);
    }
    const std::string* find(const std::string& key) const {
        const auto at = values_.find(key);
        return at == values_.end() || ambiguous_.contains(key) ? nullptr : &at->second;
    }

private:
    std::map<std::string, std::string> values_;
    std::set<std::string> ambiguous_;
};

std::string number_of(const std::string& stem) {
    int number = 0;
    return parse_number(stem, number) ? str(number) : "";
}

std::string stem_of(const std::string& view, bool whole_names) {
    std::string stem = whole_names ? view : fs::path(view).replace_extension().generic_string();
    if (stem.ends_with("_rgb")) stem.resize(stem.size() - 4);
    return stem;
}

std::string last_part(const std::string& stem) {
    return fs::path(stem).filename().string();
}

constexpr auto kAnyGeometry = PriorGeometry::unknown;

struct Place {
    fs::path folder;
    const Strings& views;
};

/// A folder of depth maps and the usual convention of its numbers.
struct DepthFolder {
    const char* folder;
    Strings endings{};
    PriorQuantity quantity = PriorQuantity::unknown;
    PriorGeometry geometry = PriorGeometry::unknown;
    PriorAlignment alignment = PriorAlignment::affine;
    bool zero_is_none = false;
};

DepthSource depth_source(PriorFiles files, const DepthFolder& row) {
    DepthSource source;
    static_cast<PriorFiles&>(source) = std::move(files);
    source.convention = {row.quantity, row.geometry, row.alignment, ""};
    if (row.zero_is_none) source.invalid = {0};
    return source;
}

DepthSource find_in(const Place& place, const std::vector<DepthFolder>& rows) {
    for (const DepthFolder& row : rows)
        if (PriorFiles files =
                match_priors((place.folder / row.folder).string(), row.endings, place.views);
            !files.empty())
            return depth_source(std::move(files), row);
    return {};
}

DepthSource find_with_params(const Place& place) {
    const fs::path params = place.folder / "sparse/0/depth_params.json";
    if (!is_file(params)) return {};
    DepthSource source = depth_source(
        match_priors((place.folder / "depths").string(), {".png"}, place.views),
        {"", {}, PriorQuantity::inverse_depth, PriorGeometry::z, PriorAlignment::metric});
    if (!source.empty()) read_depth_params(params.string(), source);
    return source;
}

/// COLMAP's maps keep the image's whole name.
PriorFiles colmap_maps(const Place& place, const char* kind) {
    for (const char* ending : {".geometric.bin", ".photometric.bin"})
        if (PriorFiles files = match_priors((place.folder / "stereo" / kind).string(), {ending},
                                            place.views, /*whole_names=*/true);
            !files.empty())
            return files;
    return {};
}

/// ACMM names a view's folder after the number of its image: 2333_00000007.
PriorFiles acmm_maps(const Place& place, const Strings& names) {
    for (const char* program : {"ACMM", "ACMP", "ACMMP"})
        for (const std::string& name : names) {
            PriorFiles found;
            for (const std::string& view : place.views) {
                int number = 0;
                std::string digits = fs::path(view).stem().string();
                if (!parse_number(digits, number) || number < 0 || number > 99999999) continue;
                digits = str(number);
                const fs::path file = place.folder / program /
                                      ("2333_" + std::string(8 - digits.size(), '0') + digits) /
                                      name;
                if (is_file(file)) found.files[view].path = file.string();
            }
            if (found.empty()) continue;
            found.what = str(program, "/*/", name);
            return found;
        }
    return {};
}

/// Files beside the photographs, like Omnidata's for MonoSDF: 000000_depth.npy.
PriorFiles beside(const Place& place, const std::string& ending) {
    PriorFiles found;
    for (const std::string& view : place.views) {
        std::string stem = fs::path(view).stem().string();
        if (stem.ends_with("_rgb")) stem.resize(stem.size() - 4);
        const fs::path file = place.folder / (stem + ending);
        if (is_file(file)) found.files[view].path = file.string();
    }
    if (!found.empty()) found.what = "*" + ending, found.centre_crop = true;
    return found;
}

DepthSource find_depth(const Place& place) {
    using enum PriorAlignment;
    constexpr auto kDepth = PriorQuantity::depth;
    const Strings kNumbers{"_pred.npy", "_depth.npy", "_raw_depth_meter.npy", ".npy",
                           ".pfm",      "_pred.png",  "_depth.png",           ".png"};
    Strings midas{".pfm", ".png"};  // MiDaS's run.py appends the model: 0001-dpt_large_384.pfm
    for (const char* model : {"dpt_beit_large_512", "dpt_beit_large_384", "dpt_swin2_large_384",
                              "dpt_large_384", "dpt_hybrid_384", "midas_v21_384"})
        for (const char* ending : {".png", ".pfm"})
            midas.insert(midas.begin(), str("-", model, ending));
    DepthSource found =
        find_in(place, {{"depth_vggt", {"_pred.npy", ".npy"}, kDepth, kAnyGeometry, scale, true},
                        {"depth_npy", kNumbers}});
    if (found.empty()) found = find_with_params(place);
    if (found.empty()) found = read_transforms_depth(place.folder.string(), place.views);
    if (found.empty())
        found = depth_source(colmap_maps(place, "depth_maps"),
                             {"", {}, kDepth, PriorGeometry::z, metric, true});
    if (found.empty())
        found = find_in(place, {{"depth_est", {".pfm"}, kDepth, kAnyGeometry, metric, true},
                                {"renders_depth", {".npy"}, kDepth, PriorGeometry::z, metric, true},
                                {"metric3d", kNumbers, kDepth, kAnyGeometry, scale, true},
                                {"depth_bw", {"_pred.png", "_depth.png", ".png"}},
                                {"depths", kNumbers},
                                {"depth", kNumbers},
                                {"vis_depth", kNumbers},
                                {"midas", midas}});
    if (found.empty())
        found = depth_source(acmm_maps(place, {"depths_geom.dmb", "depths.dmb"}),
                             {"", {}, kDepth, PriorGeometry::z, metric, true});
    for (const char* folder : {".", "omnidata"})
        if (found.empty())
            found = depth_source(beside({place.folder / folder, place.views}, "_depth.npy"), {""});
    return found;
}

NormalSource find_normal(const Place& place) {
    const Strings endings{"_normal.npy", "_normals.npy", "_pred.npy", ".npy", ".pfm",
                          "_normal.png", "_normals.png", "_pred.png", ".png"};
    NormalSource found;
    const auto take = [&found](PriorFiles files) {
        if (found.empty()) static_cast<PriorFiles&>(found) = std::move(files);
    };
    for (const char* folder : {"normal", "normals", "normals_npy"})
        take(match_priors((place.folder / folder).string(), endings, place.views));
    take(colmap_maps(place, "normal_maps"));
    if (found.empty()) {
        take(acmm_maps(place, {"normals.dmb"}));
        if (!found.empty()) found.convention.frame = NormalFrame::world;
    }
    for (const char* folder : {".", "omnidata"})
        take(beside({place.folder / folder, place.views}, "_normal.npy"));
    return found;
}

ConfidenceSource find_confidence(const Place& place) {
    ConfidenceSource found;
    static_cast<PriorFiles&>(found) = match_priors((place.folder / "depth_vggt").string(),
                                                   {"_conf.npy", "_confidence.npy"}, place.views);
    found.from_one = !found.empty();
    if (found.empty())
        static_cast<PriorFiles&>(found) = match_priors((place.folder / "confidence").string(),
                                                       {".npy", ".pfm", "_conf.npy"}, place.views);
    return found;
}

PriorSources find_formats(const Place& place) {
    PriorSources found;
    found.depth = find_depth(place);
    found.normal = find_normal(place);
    found.confidence = find_confidence(place);
    found.features = match_priors((place.folder / "features").string(), {".npy"}, place.views);
    for (const char* folder : {"sky", "sky_mask", "sky_masks"})
        if (found.sky.empty())
            found.sky = match_priors((place.folder / folder).string(), {".png", ".jpg", ".npy"},
                                     place.views);
    return found;
}

}  // namespace

PriorFiles match_priors(const std::string& folder,
                        const std::vector<std::string>& endings,
                        const std::vector<std::string>& views,
                        bool whole_names) {
    std::error_code failure;
    std::vector<std::string> files;  // relative to the folder
    constexpr std::size_t kMostFiles = 1000000;
    for (fs::recursive_directory_iterator entry(folder, failure), end;
         !failure && entry != end && files.size() < kMostFiles; entry.increment(failure)) {
        if (entry.depth() > 8) entry.disable_recursion_pending();
        if (entry->is_regular_file(failure))
            files.push_back(entry->path().lexically_relative(folder).generic_string());
    }
    UniqueMap last_parts, numbers;  // of views: one file must not serve two views
    for (const std::string& view : views) {
        const std::string stem = stem_of(view, whole_names);
        last_parts.add(last_part(stem), view);
        if (const std::string n = number_of(last_part(stem)); !n.empty()) numbers.add(n, view);
    }
    PriorFiles found;
    for (const std::string& ending : endings) {
        UniqueMap by_stem, by_last, by_number;
        for (const std::string& file : files) {
            if (!file.ends_with(ending) || file.size() == ending.size()) continue;
            const std::string stem = file.substr(0, file.size() - ending.size()),
                              last = last_part(stem);
            by_stem.add(stem, file), by_last.add(last, file);
            if (const std::string n = number_of(last); !n.empty()) by_number.add(n, file);
        }
        for (const std::string& view : views) {
            const std::string stem = stem_of(view, whole_names), last = last_part(stem);
            const std::string number = number_of(last);
            const std::string* file = by_stem.find(stem);
            if (!file && last_parts.find(last)) file = by_last.find(last);
            if (!file && !number.empty() && numbers.find(number)) file = by_number.find(number);
            if (file) found.files[view].path = (fs::path(folder) / *file).string();
        }
        if (found.files.empty()) continue;
        found.what = str(fs::path(folder).filename().string(), "/*", ending);
        break;
    }
    return found;
}

Strings prior_folders(const PriorQuery& query) {
    const fs::path scene(query.scene);
    if (query.folder.empty())
        return {(scene / "priors").string(), scene.string(), (scene / "dense").string()};
    std::error_code failure;
    if (fs::is_directory(scene / query.folder, failure)) return {(scene / query.folder).string()};
    if (fs::is_directory(query.folder, failure)) return {query.folder};
    throw input_error("E_PRIORS: ", query.folder,
                      ": folder not found, neither in the scene nor here");
}

PriorSources find_priors(const PriorQuery& query) {
    PriorSources found;
    const auto take = [](auto& to, auto& from) {
        if (to.empty()) to = std::move(from);
    };
    for (const std::string& folder : prior_folders(query)) {
        PriorSources here = is_file(fs::path(folder) / "priors.json")
                                ? read_priors_json(folder, query.views)
                                : find_formats({folder, query.views});
        // A confidence map belongs to the depth map beside it.
        if (found.depth.empty() && found.confidence.empty())
            take(found.confidence, here.confidence);
        take(found.depth, here.depth), take(found.normal, here.normal);
        take(found.features, here.features), take(found.sky, here.sky);
    }
    return found;
}

}  // namespace tvsgs
