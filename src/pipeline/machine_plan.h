// What a training takes in memory, and which machine that asks for: the plan's decision `machines`.
// [docs/guide/plan.md]
#pragma once

#include <optional>
#include <string>

#include "optim/plan.h"
#include "pipeline/memory_plan.h"

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
    ProcessCount processes;
    std::int64_t first = 0;  // splats at the start
    ExpectedSplats expected;
    bool may_stream = false;           // photo_bytes is the plan's to choose
    bool may_compact = false;          // tv.lists as well
    bool may_leave_harmonics = false;  // and optim.harmonics
};

/// The first of these that holds the expected splats: all on the device; photographs on the host;
/// compact lists of votes; both; all that and colours on the host; blocks, or more GPUs, of which
/// it only speaks. Where none does, training takes what holds most splats if the first ones fit
/// into it, and stops growing there; else it cannot start, and plan_memory() says so. Of several
/// processes each holds its share.
Decision plan_machines(const Scene& scene, const TrainOptions& options, const MachineInputs& in);

/// To be asked before plan_machines(): steps of colours out of view wait on a GPU that has room for
/// it, where no view sees more than a small part of many splats.
std::optional<Decision> plan_waiting(const Scene& scene,
                                     const TrainOptions& options,
                                     const MachineInputs& in);

}  // namespace tvsgs
