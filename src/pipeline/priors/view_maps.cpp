#include "pipeline/priors/view_maps.h"

#include <algorithm>

#include "core/error.h"
#include "core/log.h"
#include "core/scene/prior_maps.h"

namespace tvsgs {
namespace {

bool has_map(const View& view, std::string_view name) {
    if (name == "mask") return !view.mask.empty();
    return std::any_of(view.maps.begin(), view.maps.end(),
                       [&](const ViewMap& map) { return map.name == name; });
}

bool goes_with_another(std::string_view name) {
    return name == prior_map::kConfidence || name == prior_map::kCoarseFeatures;
}

}  // namespace

std::vector<MissingMap> missing_maps(const LossOptions& options, const std::vector<View>& views) {
    std::vector<MissingMap> missing;
    for (const TermOnList& term : terms_on_list(options)) {
        if (!(term.weight > 0)) continue;
        for (const std::string_view map : term.needs.view_maps)
            if (!goes_with_another(map) &&
                std::none_of(views.begin(), views.end(),
                             [&](const View& view) { return has_map(view, map); }))
                missing.push_back({term.key, std::string(map)});
    }
    return missing;
}

void complete_maps(const LossOptions& options,
                   const DescriptorOptions& descriptors,
                   std::vector<View>& views) {
    const auto is_features = [](const MissingMap& m) { return m.map == prior_map::kFeatures; };
    std::vector<MissingMap> missing = missing_maps(options, views);
    const bool describe = std::any_of(missing.begin(), missing.end(), is_features);
    std::erase_if(missing, is_features);
    if (!missing.empty()) {
        std::string what;
        for (const MissingMap& m : missing)
            what += str(what.empty() ? "" : ", ", "loss.", m.term, " needs map '", m.map, "'");
        throw Error(
            ExitCode::usage,
            str(what, ", which none of the ", views.size(),
                " training views has; give such priors with --priors, or set the weight to 0"));
    }
    if (!describe) return;
    // Coarse features without fine ones would be of another kind.
    for (View& view : views)
        std::erase_if(view.maps,
                      [](const ViewMap& map) { return map.name == prior_map::kCoarseFeatures; });
    const std::int64_t bytes = add_descriptors(descriptors.kind, views);
    spdlog::info(
        "No priors with features: uses descriptors of the photographs (descriptors.kind = {}), {} "
        "MiB",
        descriptors.kind == Descriptor::orient ? "orient32" : "census32", bytes >> 20);
}

}  // namespace tvsgs
