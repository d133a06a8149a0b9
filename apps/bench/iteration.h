// The iteration of a training with the losses of a configuration, again and again.
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/scene/scene.h"
#include "optim/loop/train.h"
#include "render/backbone.h"

namespace tvsgs {

/// What train() does with the first training view at the last iteration, but for the splats: they
/// stay as they are (all rates are 0), and none come or go. No tensor voting.
template <class Device>
class BenchIteration {
public:
    /// `scene` has to outlive this; `splats` are copied.
    BenchIteration(const Scene& scene, TrainOptions options, const Gaussians<Cpu>& splats);
    BenchIteration(BenchIteration&&) noexcept;
    ~BenchIteration();

    /// What the backbone of the view does is timed by the backbone's own clock.
    void run(StageClock<Device>& clock);

    Backbone<Device>& backbone();  // of the view, not of others
    Maps maps() const;             // of the view

    /// Of the last run(): weighted values of the losses, and how many pixels could be compared with
    /// another one (0 without).
    std::vector<std::pair<std::string, double>> losses() const;
    int compared_pixels() const;

private:
    struct Parts;
    std::unique_ptr<Parts> parts_;
};

}  // namespace tvsgs
