// What a scene needs, and what it does not: one look before the first step.  docs/guide/plan.md
#pragma once

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "core/scene/scene.h"
#include "optim/loop/train.h"
#include "optim/photo/sky.h"
#include "optim/views/matchable.h"

namespace tvsgs {

/// The widest angle between the optical axes of two views at which pairing them is known to help.
inline constexpr float kWideAngleDeg = 37;

/// What the decisions go by. A few thousand points stand for all of the initial cloud.
struct SceneLook {
    int train_views = 0, test_views = 0;
    double megapixels = 0;        // of all training views
    std::size_t points = 0;       // of the initial cloud
    double pixels = 0;            // of a view that stereo could match, median
    double matchable = 1;         // their share of the view, median
    double points_per_pixel = 0;  // initial points there over them, median
    double reduction = 1;         // of the photographs, median: files over views, in width
    /// The colour that the images' borders have, its share of them, least over the views, and the
    /// share of the initial points there, where they are seen; 0 to 255. Share 0: the views differ.
    int background[3] = {0, 0, 0};
    double background_border = 0, background_points = 0;
    bool outside = false;            // a mask leaves out what its photograph shows
    double views_in_pairs = 0;       // share within loss.multi_view's relative limits
    double views_in_wide_pairs = 0;  // the same, those without one up to kWideAngleDeg
    double pose_error = NAN;         // View::pose_error_px, median of the views that have one
    double exposure_drift =
        0;  // ratio of a view's brightness to that of its nearest view - 1, where
            // both see the same, median; the largest of the views; NaN: unknown
};
/// `masks`: only what is inside of them counts. `sky`: what it shows cannot be matched.
SceneLook look_at(const Scene& scene,
                  const ViewPairOptions& limits,
                  bool masks = false,
                  const SkyLook& sky = {});

/// What is known of the masks before anything is decided; docs/guide/plan.md.
struct MaskLook {
    int views = 0, masked = 0;  // training views; those with a mask
    int outside = 0;            // those whose mask leaves out more than what the lens did not see
    std::string empty;          // the first view whose mask has no pixel of the object
    double border = 0;          // share of an image's border that is outside, median of the masked
    double matched = 0;         // share of the points, where views see them, that is outside
};
MaskLook look_at_masks(const std::vector<View>& train, const std::vector<Vec3f>& points);

/// What was measured, for people.
std::string summary(const SceneLook& look);

/// The rasteriser that the plan chooses where it may.
inline constexpr const char* kDiscs = "surfel";

/// Keys and what they are to be.
using Settings = std::vector<std::pair<std::string, std::string>>;

struct Decision {
    std::string name, choice;
    std::string reason;                  // what was measured, and against what
    double measured = 0, threshold = 0;  // NaN: nothing was
    Settings settings;                   // what the choice means
};

/// Whether masks are used, and for what. Nothing where there are none.
std::vector<Decision> plan_masks(const MaskLook& look);

/// Whether a sky is drawn behind the splats, by SkyLook::share.
Decision plan_sky(double share);

/// Which settings to start from: "sparse" or "dense", which measured points have no votes in.
Decision plan_settings(int train_views, bool measured_points);

/// On the cloud that comes with the scene: whether stereo makes another one.
Decision plan_cloud(const SceneLook& look, bool dense);

/// Says that the training is planned for `given` points per pixel in place of those measured.
Decision given_coverage(double measured, double given);

/// What the plan of the training goes by, beside the look.
struct PlanInputs {
    bool dense = false;      // the settings that were chosen
    bool discs = false;      // kDiscs may be chosen: fast here, and nobody asks for another
    TrainOptions options;    // as resolved so far
    int configured = 0;      // iterations that their schedule was made for
    int wanted = -1;         // iterations that the user asks for; below 0: nobody does
    bool normals = false;    // of stereo are there, and nobody asks for other priors
    LossOptions multi_view;  // the dense settings' losses, whose multi-view terms are taken
};

/// On the cloud that training starts from.
std::vector<Decision> plan_training(const SceneLook& look, const PlanInputs& inputs);

}  // namespace tvsgs
