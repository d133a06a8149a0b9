// From the options that are asked for to the scene and the options that a run trains with.
#pragma once

#include "core/device/device_choice.h"
#include "pipeline/priors/stereo_priors.h"
#include "pipeline/run/checkpoints.h"
#include "pipeline/run/run_options.h"
#include "plan/settings.h"

namespace tvsgs {

/// A run before its first step. Nothing changes its options from here on.
struct Resolved {
    Scene scene;
    const RunOptions options;  // of config.json
    const RunPlan plan;        // empty: the options ask for none
};

/// Reads the scene, decides where a plan is asked for, and provides what the training needs: start
/// points, the sky, exposures, fixed splats, priors. `plan_only`: the plan will only be printed, so
/// neither stereo nor priors are made. Throws Error.
Resolved resolve(const DeviceChoice& device, const Configuration& asked, bool plan_only);

/// The same for a run that continues from `point`: it keeps its decisions and its start points.
Resolved resolve_resumed(const DeviceChoice& device,
                         const Configuration& asked,
                         const ResumePoint& point);

/// Throws Error(ExitCode::usage) for a configuration that cannot work. To be called before the
/// photographs are read, which takes a while. `before_plan`: the plan may still set keys.
void check_consistency(const TrainOptions& options, bool before_plan = false);

/// Fills the maps that the losses need, from the sources of `priors.source`: files, stereo,
/// descriptors. `stereo`: the points that the scene came with, so that a resumed run gets the same
/// maps. Throws Error if a map is missing.
void provide_maps(const DeviceChoice& device,
                  const RunOptions& options,
                  StereoStart stereo,
                  Scene& scene);

}  // namespace tvsgs
