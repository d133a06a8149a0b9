// Decides how a training is held in memory: the decision `machines`.  [docs/guide/plan.md]
#pragma once

#include <string>

#include "plan/memory.h"
#include "plan/settings.h"

namespace tvsgs {

/// Splats that a training is expected to reach, and where the number comes from.
struct ExpectedSplats {
    std::int64_t count = 0;
    std::string source;
};
/// `first` without growth; the cap if the user sets it (`capped`); else a multiple of `first`.
ExpectedSplats expected_splats(const Scene& scene,
                               const TrainOptions& options,
                               std::int64_t first,
                               bool capped);

/// Inputs of the decision beside scene and options.
struct MachineInputs {
    bool cuda = false;
    MemoryLimits limits;
    std::int64_t first = 0;  // splats at the start
    ExpectedSplats expected;
    bool may_stream = false;   // the plan may choose photo_bytes
    bool may_compact = false;  // the plan may choose tv.lists
};

/// The first of these that holds the expected splats: all on the device; photographs on the host;
/// compact lists of votes; both. If none does, it proposes blocks and takes the way that holds most
/// splats: growth stops there, or plan_memory() throws if the first splats do not fit.
Decision decide_machines(const Scene& scene, const TrainOptions& options, const MachineInputs& in);

}  // namespace tvsgs
