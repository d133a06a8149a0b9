// Estimates the time of a training before its first step, from a short one of the same scene.
#pragma once

#include <string>

#include "core/device/device_choice.h"
#include "core/scene/scene.h"
#include "optim/loop/train.h"

namespace tvsgs {

struct TimePlan {
    double low = 0, high = 0;  // seconds of training, without evaluations and stereo
    int steps = 0, of = 0;     // timed iterations; iterations until all phases have begun
    double each = 0;           // seconds per iteration, mean
    int iterations = 0;        // of the training
    bool grows = false;

    /// A line for people, with its basis.
    std::string text() const;
};

/// Trains on `scene` for 40 steps with the schedule fitted into them, at most 5 s, or 20 s if steps
/// are slow. `high` leaves room for phases that the trial did not reach. Throws as train() does.
TimePlan plan_time(const DeviceChoice& device, const Scene& scene, const TrainOptions& options);

}  // namespace tvsgs
