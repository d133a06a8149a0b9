// What a training takes in memory, and which machine that asks for: the plan's decision `machines`.
// [docs/guide/plan.md]
#pragma once

#include <string>

#include "plan/memory.h"
#include "plan/plan.h"

namespace tvsgs {

/// Splats that a training is expected to reach, and what says so.
struct ExpectedSplats {
    std::int64_t count = 0;
    std::string source;
};
/// `first` where there is no growth; else the cap, where it is `capped` by the user; else some
/// times as many, a guess. Never more than growth may reach.
ExpectedSplats expected_splats(const Scene& scene,
                               const TrainOptions& options,
                               std::int64_t first,
                               bool capped);

/// What the decision goes by, beside scene and options.
struct MachineInputs {
    bool cuda = false;
    MemoryLimits limits;
    std::int64_t first = 0;  // splats at the start
    ExpectedSplats expected;
    bool may_stream = false;   // the plan may choose photo_bytes
    bool may_compact = false;  // the plan may choose tv.lists
};

/// The first of these that holds the expected splats: all on the device; photographs on the host;
/// compact lists of votes; both. Where none does, it proposes blocks and takes the one that holds
/// most splats: growth stops there, or plan_memory() refuses where the first splats do not fit.
Decision plan_machines(const Scene& scene, const TrainOptions& options, const MachineInputs& in);

}  // namespace tvsgs
