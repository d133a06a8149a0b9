// Functions of read_priors(), one per kind of map; called by pipeline/priors/priors.cpp.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "io/priors/prior_sources.h"
#include "mvs/stereo/view_selection.h"
#include "pipeline/priors/priors.h"

namespace tvsgs {

/// A training view, and the visible scene points that its priors are compared with.
struct PriorView {
    View* view;
    std::optional<Intrinsics> camera;  // of the original photograph, if it was undistorted
    std::vector<VisiblePoint> points;
};

struct PriorInputs {
    const PriorOptions& options;
    const PriorSources& sources;
    const std::vector<Vec3f>& points;
    bool depth, order, normal, confidence, features, coarse_features;  // the maps to read
};

// Each function fills its maps and returns a text for the log; views without a file get no map.
std::string fill_depth(const PriorInputs& in, std::vector<PriorView>& views);
std::string fill_confidence(const PriorInputs& in, std::vector<PriorView>& views);
std::string fill_normals(const PriorInputs& in, std::vector<PriorView>& views);
std::string fill_features(const PriorInputs& in, std::vector<PriorView>& views);

/// Returns null if the view has no file.
const PriorFile* file_of(const PriorFiles& files, const PriorView& view);

/// A map as in its file, with NaN for values that are not finite, and its placement in the view.
struct PlacedMap {
    ImageF map;
    MapPlacement placement;
};
PlacedMap read_placed(const PriorFiles& source,
                      const PriorFile& file,
                      const PriorView& view,
                      int channels);

/// [H W] of the photograph: 1 for sky; empty: the view has no sky mask.
std::vector<std::uint8_t> sky_of(const PriorInputs& in, const PriorView& view);

/// Adds a map of the photograph's size.
void add_map(View& view, std::string_view name, int channels, std::vector<float> values);

/// Warns of views whose maps have no number at all; throws Error(ExitCode::input) if these are all
/// `maps`. `kind`: "depth".
void report_empty_maps(const std::string& kind,
                       const PriorFiles& files,
                       const std::vector<std::string>& views,
                       std::size_t maps);

/// The first five names, each with a remark; for messages.
std::string listed(const std::vector<std::string>& names);

}  // namespace tvsgs
