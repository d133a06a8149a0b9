// What a scene needs, and what it does not: one look before the first step.  docs/plan.md
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "core/scene.h"
#include "optim/train.h"

namespace tvsgs {

/// What the decisions go by. Points stand for a few thousand of the initial cloud; where none lies
/// in two views, what would need them is NaN.
struct SceneLook {
    int views = 0;
    std::size_t points = 0;           // of the initial cloud
    double points_per_pixel = 0;      // that over the view's pixels
    double views_per_point = 0;       // mean over the points
    double direction_spread_deg = 0;  // median over points of the widest angle between two views
    double views_with_neighbour = 0;  // share within loss.multi_view's relative limits
    double exposure_drift = 0;  // largest median ratio - 1 of a view's brightness to that of its
                                // nearest view, at points in both
};
SceneLook look_at(const Scene& scene, const NeighbourOptions& limits);

/// Keys and what they are to be.
using Settings = std::vector<std::pair<std::string, std::string>>;

struct Decision {
    std::string name, choice;
    std::string reason;  // what was measured, and against what
    double measured = 0, threshold = 0;
    std::string source;  // of the threshold
    Settings settings;   // empty: nothing to change
};

/// What was measured, for people.
std::string summary(const SceneLook& look);

/// Which settings to start from: "sparse" or "dense".
Decision plan_settings(int train_views);

/// On the cloud that comes with the scene: whether stereo makes another. `given`: the user named
/// it.
std::vector<Decision> plan_cloud(const SceneLook& look, bool given);

/// On the cloud that training starts from. `options`: as resolved so far; `configured`: iterations
/// that their schedule was made for; `wanted`: iterations that the user asks for, 0: none.
std::vector<Decision> plan_training(const SceneLook& look,
                                    const TrainOptions& options,
                                    int configured,
                                    int wanted = 0);

}  // namespace tvsgs
