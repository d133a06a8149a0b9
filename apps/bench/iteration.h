// Times of the iteration of a training, again and again.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "core/scene/scene.h"
#include "optim/loop/train.h"
#include "render/backbone.h"

namespace tvsgs {

struct IterationTimes {
    std::vector<double> all_ms;                                     // with one wait at the end
    std::vector<std::vector<std::pair<std::string, double>>> laps;  // ms, with a wait per stage
    std::vector<double> unaccounted;  // shares of these iterations that are in no stage
    RenderCounts counts;
    BlendWork work;
    std::vector<std::pair<std::string, double>> losses;  // weighted
    int compared_pixels = 0;  // that could be compared with another view; 0 without one
    Maps maps{};
    std::int64_t bytes = 0;  // in use on the device at the end
};

/// Repeats what train() does with the first training view at the last iteration, but for the
/// splats: they stay as they are (all rates are 0), and none come or go. No tensor voting.
template <class Device>
IterationTimes time_iteration(const Scene& scene,
                              const TrainOptions& options,
                              const Gaussians<Cpu>& splats,
                              int warm_up,
                              int repetitions);

}  // namespace tvsgs
