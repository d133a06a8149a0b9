#include "pipeline/priors/priors.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/device/parallel_lists.h"
#include "core/error.h"
#include "core/log.h"
#include "core/scene/prior_maps.h"
#include "io/files/read_file.h"
#include "io/scene/scene_layout.h"
#include "mvs/stereo/descriptors.h"
#include "pipeline/priors/prior_parts.h"

namespace tvsgs {

const PriorFile* file_of(const PriorFiles& files, const PriorView& view) {
    const auto at = files.files.find(view.view->name);
    return at == files.files.end() ? nullptr : &at->second;
}

PlacedMap read_placed(const PriorFiles& source,
                      const PriorFile& file,
                      const PriorView& view,
                      int channels) {
    ImageF map = read_prior_map(file.path, channels, source.layout);
    for (float& value : map.pixels)
        if (!std::isfinite(value)) value = std::numeric_limits<float>::quiet_NaN();
    std::optional<PhotoWindow> window = file.window;
    const ImageU8& photo = view.view->photo;
    if (!window && source.centre_crop && map.width == map.height && photo.width != photo.height)
        window = centre_square(*view.view);
    MapPlacement placement(file.path, *view.view, view.camera, window, map);
    return {std::move(map), std::move(placement)};
}

std::vector<std::uint8_t> sky_of(const PriorInputs& in, const PriorView& view) {
    const PriorFile* const file = file_of(in.sources.sky, view);
    if (file == nullptr) return {};
    const PlacedMap mask = read_placed(in.sources.sky, *file, view, 1);
    const ImageU8& photo = view.view->photo;
    const ImageF sized = resample_map(mask.map, mask.placement, *view.view, photo.width,
                                      photo.height, MapBlend::nearest);
    // Pictures use 255, arrays may use 1.
    float top = 0;
    for (const float value : mask.map.pixels)
        if (value > top) top = value;
    std::vector<std::uint8_t> sky;
    for (const float value : sized.pixels) sky.push_back(value > 0.5f * (top > 1 ? 255 : 1));
    return sky;
}

void add_map(View& view, std::string_view name, int channels, std::vector<float> values) {
    view.maps.push_back(
        {std::string(name), view.photo.width, view.photo.height, channels, std::move(values)});
}

std::string listed(const std::vector<std::string>& names) {
    constexpr std::size_t kShown = 5;
    std::string text;
    for (std::size_t i = 0; i < std::min(names.size(), kShown); ++i)
        text += (i > 0 ? ", " : "") + names[i];
    return names.size() > kShown ? str(text, " and ", names.size() - kShown, " more") : text;
}

void report_empty_maps(const std::string& kind,
                       const PriorFiles& files,
                       const std::vector<std::string>& views,
                       std::size_t maps) {
    if (views.empty()) return;
    const std::string what =
        str(kind, " maps of ", views.size(), " views have no valid number: ", listed(views));
    if (views.size() == maps)
        throw input_error("E_PRIORS: ", files.what, ": all ", what,
                          "; make them again, or remove them");
    spdlog::warn("Priors: {}", what);
}

namespace {

/// Cameras of photographs that loading undistorts; priors match the original photographs.
std::map<std::string, Intrinsics> distorted_cameras(const SceneOptions& options) {
    const SceneLayout layout = read_layout(options);
    std::map<std::string, Intrinsics> cameras;
    for (const ColmapImage& image : layout.model.images) {
        const Intrinsics& camera = layout.model.cameras.at(image.camera_id);
        if (camera.distortion.kind != Distortion::Kind::none) cameras[image.name] = camera;
    }
    return cameras;
}

std::vector<PriorView> views_of(const SceneOptions& options, Scene& scene) {
    const auto cameras = distorted_cameras(options);
    std::vector<PriorView> views(scene.train.size());
    parallel_for_heavy(Cpu{}, int(views.size()), [&](int i) {
        PriorView& view = views[i];
        view.view = &scene.train[i];
        if (const auto at = cameras.find(view.view->name); at != cameras.end())
            view.camera = at->second;
        view.points = visible_points(view.view->camera, scene.points.positions);
    });
    return views;
}

/// Throws where files are required and a wanted map has none.
void require_files(const PriorOptions& options,
                   const PriorQuery& query,
                   const std::string& lacks,
                   bool none_at_all) {
    if (options.source != PriorOptions::Source::disk && (options.dir.empty() || !none_at_all))
        return;
    throw Error(ExitCode::input, "E_PRIORS: a loss of this configuration needs prior ", lacks,
                ", not found in ", fmt::format("{}", fmt::join(prior_folders(query), ", ")),
                "; give the folder with --priors (files: "
                "docs/guide/priors.md), or set the weight of that loss to 0");
}

}  // namespace

void read_priors(const PriorOptions& options,
                 const MapNames& wanted,
                 const SceneOptions& scene_options,
                 Scene& scene) {
    const auto wants = [&](std::string_view name) {
        return std::ranges::find(wanted, name) != wanted.end();
    };
    PriorSources sources;
    const PriorInputs in{options,
                         sources,
                         scene.points.positions,
                         wants(prior_map::kDepth),
                         wants(prior_map::kDepthOrder),
                         wants(prior_map::kNormal),
                         wants(prior_map::kConfidence),
                         wants(prior_map::kFeatures),
                         wants(prior_map::kCoarseFeatures)};
    const bool depth = in.depth || in.order, features = in.features || in.coarse_features;
    const bool wanted_at_all = depth || in.normal || features;
    if (!wanted_at_all && (!options.dir.empty() || options.source == PriorOptions::Source::disk))
        spdlog::warn("Priors are given, but no loss of this configuration uses them");
    const bool from_disk = options.source == PriorOptions::Source::automatic ||
                           options.source == PriorOptions::Source::disk;
    if (!from_disk || !wanted_at_all) return;

    with_context("reading priors of " + scene_options.path, [&] {
        PriorQuery query{scene_options.path, options.dir, {}};
        for (const View& view : scene.train) query.views.push_back(view.name);
        sources = find_priors(query);
        std::string lacks;
        bool none_at_all = true;
        const auto look = [&](bool is_wanted, const PriorFiles& files, const char* what) {
            if (is_wanted && files.empty())
                lacks += (lacks.empty() ? "" : ", ") + std::string(what);
            else if (is_wanted)
                none_at_all = false;
        };
        look(depth, sources.depth, "depth"), look(in.normal, sources.normal, "normals");
        look(features, sources.features, "features");
        if (!lacks.empty()) require_files(options, query, lacks, none_at_all);

        std::vector<PriorView> views = views_of(scene_options, scene);
        std::string found;
        const auto note = [&found](const std::string& text) {
            if (!text.empty()) found += (found.empty() ? "" : "; ") + text;
        };
        if (depth && !sources.depth.empty()) note(fill_depth(in, views));
        if (in.confidence && !sources.confidence.empty()) note(fill_confidence(in, views));
        if (in.normal && !sources.normal.empty()) note(fill_normals(in, views));
        if (features && !sources.features.empty()) note(fill_features(in, views));
        if (!found.empty()) spdlog::info("Priors: {}", found);
    });
}

namespace {

struct MissingMap {
    std::string term, map;
};

bool has_map(const View& view, std::string_view name) {
    if (name == "mask") return !view.mask.empty();
    return std::ranges::any_of(view.maps, [&](const ViewMap& map) { return map.name == name; });
}

/// Maps that no view has, of terms with a weight above 0. Without maps that go with another
/// (confidence, coarse_features).
std::vector<MissingMap> missing_maps(const LossOptions& options, const std::vector<View>& views) {
    std::vector<MissingMap> missing;
    for (const TermOnList& term : terms_on_list(options)) {
        if (!(term.weight > 0)) continue;
        for (const std::string_view map : term.needs.view_maps)
            if (map != prior_map::kConfidence && map != prior_map::kCoarseFeatures &&
                std::ranges::none_of(views, [&](const View& view) { return has_map(view, map); }))
                missing.push_back({term.key, std::string(map)});
    }
    return missing;
}

}  // namespace

void complete_maps(const LossOptions& options, std::vector<View>& views) {
    const auto is_features = [](const MissingMap& m) { return m.map == prior_map::kFeatures; };
    std::vector<MissingMap> missing = missing_maps(options, views);
    const bool describe = std::erase_if(missing, is_features) > 0;
    if (!missing.empty()) {
        std::string what;
        for (const MissingMap& m : missing)
            what += str(what.empty() ? "" : ", ", "loss.", m.term, " needs map '", m.map, "'");
        throw Error(ExitCode::usage, what, ", which none of the ", views.size(),
                    " training views has; give such priors with --priors, or set the weight to 0");
    }
    if (!describe) return;
    // Coarse features without fine ones would be of another kind.
    for (View& view : views)
        std::erase_if(view.maps,
                      [](const ViewMap& map) { return map.name == prior_map::kCoarseFeatures; });
    const std::int64_t bytes = add_descriptors(views);
    spdlog::info("No priors with features: uses descriptors of the photographs, {} MiB",
                 bytes >> 20);
}

}  // namespace tvsgs
