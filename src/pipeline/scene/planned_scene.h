// From options to the scene that is trained on, with what it needs decided on the way.
#pragma once

#include "core/device/device_choice.h"
#include "pipeline/priors/stereo_priors.h"
#include "pipeline/run/run_options.h"
#include "plan/settings.h"

namespace tvsgs {

/// Throws Error(ExitCode::usage) for a configuration that cannot work; to be called before the
/// photographs are read, which takes a while.
void check_consistency(const TrainOptions& options);

/// The scene. --until converged needs views that do not train: the test views, or, without any, one
/// that is held out here and noted in `table`. Throws Error(ExitCode::usage) where a `resumed` run
/// would have to hold one out, as it has trained on all of its views. Checks the masks, and drops
/// the points outside of those of an object.
Scene read_views(RunOptions& options, bool resumed, OptionTable& table);

/// Fills the maps that the losses ask for: from files, from `stereo`, descriptors, as
/// `priors.source` says. A run that is resumed has the points of its checkpoint then, so that the
/// maps are those it began with; `stereo` goes by those that the scene came with. Throws Error
/// where one is missing.
void provide_maps(const DeviceChoice& device,
                  const RunOptions& options,
                  StereoStart stereo,
                  Scene& scene);

/// The scene with its initial cloud and its priors. Where a plan is asked for, its decisions are
/// made as soon as what they go by is known: the views, the cloud that comes with them, the cloud
/// that training starts from. `plan_only`: the plan is only printed, so stereo does not run.
/// `table` refers to `options`.
Scene read_and_plan(const DeviceChoice& device,
                    bool plan_only,
                    RunOptions& options,
                    OptionTable& table,
                    RunPlan& plan);

}  // namespace tvsgs
