// What the parts of read_priors() share: pipeline/priors/priors.cpp calls one for each kind of map.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "io/priors/prior_sources.h"
#include "mvs/stereo/visible_points.h"
#include "pipeline/priors/priors.h"

namespace tvsgs {

/// A training view with what the priors are compared with.
struct PriorView {
    View* view;
    std::optional<Intrinsics> camera;  // of the photograph's file, where it was undistorted
    std::vector<VisiblePoint> points;
};

struct PriorInputs {
    const PriorOptions& options;
    const PriorSources& sources;
    const std::vector<Vec3f>& points;
    bool depth, order, normal, confidence, features, coarse_features;  // what is wanted
};

// Each fills maps and returns what it found, for the one line; views without a file stay without.
std::string fill_depth(const PriorInputs& in, std::vector<PriorView>& views);
std::string fill_confidence(const PriorInputs& in, std::vector<PriorView>& views);
std::string fill_normals(const PriorInputs& in, std::vector<PriorView>& views);
std::string fill_features(const PriorInputs& in, std::vector<PriorView>& views);

/// The file of a view; null: there is none.
const PriorFile* file_of(const PriorFiles& files, const PriorView& view);

/// A map as it is in its file, with NaN for what is not finite, and where it lies.
struct PlacedMap {
    ImageF map;
    MapPlacement placement;
};
PlacedMap read_placed(const PriorFiles& source,
                      const PriorFile& file,
                      const PriorView& view,
                      int channels);

/// [H W] of the photo: 1 where the sky is; empty: this view has no mask of the sky.
std::vector<std::uint8_t> sky_of(const PriorInputs& in, const PriorView& view);

/// A map of the photo's size.
void add_map(View& view, std::string_view name, int channels, std::vector<float> values);

/// Names with a remark each, the first five; for messages.
std::string listed(const std::vector<std::string>& names);

}  // namespace tvsgs
