// The maps that terms compare with: which are missing, and what takes their place.
#pragma once

#include <string>
#include <vector>

#include "mvs/stereo/descriptors.h"
#include "optim/losses/loss.h"

namespace tvsgs {

struct MissingMap {
    std::string term, map;
};

/// What terms with a weight above 0 ask for and none of the views has. Not of maps that go with
/// another one and that terms do without (confidence, coarse_features).
std::vector<MissingMap> missing_maps(const LossOptions& options, const std::vector<View>& views);

/// To be called once, when all readers have given the training views their maps. Where terms ask
/// for features and no view has any, descriptors of the photographs take their place, and a line
/// says so. Throws Error(ExitCode::usage) naming all other maps that are missing.
void complete_maps(const LossOptions& options,
                   const DescriptorOptions& descriptors,
                   std::vector<View>& views);

}  // namespace tvsgs
