// From options to the scene that is trained on, with what it needs decided on the way.
#pragma once

#include "core/device_choice.h"
#include "pipeline/run_options.h"
#include "pipeline/run_plan.h"

namespace tvsgs {

/// A configuration that cannot work is better refused before the photographs are read. Throws
/// Error(ExitCode::usage).
void check_consistency(const TrainOptions& options);

/// The scene; --until converged asks views that do not train: the test views, or one that is held
/// out, which then stands in `table`. A run that is `resumed` has none to spare.
Scene read_views(const RunOptions& options, bool resumed, OptionTable& table);

/// The scene with its initial cloud; where a plan is asked for (`plan_only`: to be looked at), what
/// it needs is decided on the way: on the views, on the cloud that comes with them, on the cloud
/// that training starts from. `table` refers to `options`.
Scene read_and_plan(const DeviceChoice& device,
                    bool plan_only,
                    RunOptions& options,
                    OptionTable& table,
                    RunPlan& plan);

}  // namespace tvsgs
