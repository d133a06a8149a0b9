// Finds the maps that loss terms need and views lack, and computes descriptors in their place.
#pragma once

#include <string>
#include <vector>

#include "mvs/stereo/descriptors.h"
#include "optim/losses/losses_list.h"

namespace tvsgs {

struct MissingMap {
    std::string term, map;
};

/// Maps used by terms with a weight above 0 that no view has. Excludes optional maps (confidence,
/// coarse_features).
std::vector<MissingMap> missing_maps(const LossOptions& options, const std::vector<View>& views);

/// Call once after all readers have added maps. If a term needs features and no view has any, adds
/// descriptors of the photographs and logs it. Throws Error(ExitCode::usage), naming all other
/// missing maps.
void complete_maps(const LossOptions& options,
                   const DescriptorOptions& descriptors,
                   std::vector<View>& views);

}  // namespace tvsgs
