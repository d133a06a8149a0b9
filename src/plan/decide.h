// Decides from the look of a scene: pure functions, which docs/guide/plan.md explains one by one.
#pragma once

#include <string>
#include <vector>

#include "io/scene/scene_reader.h"
#include "optim/loop/train.h"
#include "plan/look.h"
#include "plan/memory.h"
#include "plan/settings.h"

namespace tvsgs {

/// The rasteriser that the plan chooses if TrainingInputs::discs allows it.
inline constexpr const char* kDiscs = "surfel";

/// The choices of decide_settings().
inline constexpr const char *kFewPhotographs = "few photographs",
                            *kManyPhotographs = "many photographs";

/// Keeps the photographs in a file if they do not fit into memory. Empty: they fit.
std::vector<Decision> decide_photographs(const PhotoStorage& storage);

/// Chooses the preset. Measured points need votes, which only kFewPhotographs has.
Decision decide_settings(int train_views, bool measured_points);

/// Whether and how masks are used. Empty: there are none.
std::vector<Decision> decide_masks(const MaskLook& look);

/// Whether stereo makes a cloud in place of the scene's own. `dense`: for kManyPhotographs.
Decision decide_cloud(const SceneLook& look, bool dense);

/// Why a training cannot start from these points; empty: it can.
std::string start_fault(const StartLook& look);

/// Whether a sky is drawn behind the splats. `share`: SkyDetection::share.
Decision decide_sky(double share);

/// Whether surfaces far behind the scene's centre are meshed. `masked`: only points in masks.
Decision decide_background(double share_beyond, bool masked = false);

/// Meshes only surface that photographs confirm or enclose, if they are near enough to confirm any.
Decision decide_confirmed(const SceneLook& look);

/// Meshes only the object. Empty: the cameras or the points are not around one place.
std::vector<Decision> decide_object(const CommonBall& ball);

/// States that the training is planned for `given` points per pixel instead of the measured ones.
Decision decide_coverage(double measured, double given);

/// Removes the losses that use votes; for a training with voting switched off.
Decision drop_voting_losses();

/// Removes losses that make splats thin, if splats are flat or the rasteriser fades thin ones.
std::vector<Decision> drop_thickness_losses(const TrainOptions& options);

/// Inputs of decide_training() beside the look.
struct TrainingInputs {
    bool dense = false;        // the preset is kManyPhotographs
    bool discs = false;        // kDiscs may be chosen: fast here, and the user asks for no other
    TrainOptions options;      // as resolved so far
    int configured = 0;        // iterations that the schedule of `options` was made for
    int wanted = -1;           // iterations that the user asks for; below 0: none
    bool normals = false;      // stereo has found normals, and the user asks for no other priors
    bool supported = false;    // stereo made the start points, and the user allows init.support
    bool parts_colors = true;  // as BackboneTraits, of the backbone as resolved so far
    LossOptions multi_view;    // losses of kManyPhotographs; only multi-view terms are used
};

/// Decides on the training. `look`: at the scene with the cloud that the training starts from.
std::vector<Decision> decide_training(const SceneLook& look, const TrainingInputs& inputs);

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

/// Inputs of decide_machines() beside scene and options.
struct MachineInputs {
    bool cuda = false;
    MemoryLimits limits;
    std::int64_t first = 0;  // splats at the start
    ExpectedSplats expected;
    bool may_stream = false;   // the plan may choose photo_bytes
    bool may_compact = false;  // the plan may choose tv.lists
};

/// Chooses how memory holds a training: the first of these ways that has room for the expected
/// splats: all on the device; photographs on the host; compact lists of votes; both. If no way has
/// room, it proposes blocks and takes the way that holds most splats. Growth then stops at that
/// number, or plan_memory() throws if the first splats do not fit.
Decision decide_machines(const Scene& scene, const TrainOptions& options, const MachineInputs& in);

}  // namespace tvsgs
