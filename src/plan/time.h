// How long a training will take, before its first step, by a short one of the same scene.
#pragma once

#include <string>

#include "core/device/device_choice.h"
#include "core/scene/scene.h"
#include "optim/loop/train.h"

namespace tvsgs {

struct TimePlan {
    double low = 0, high = 0;  // seconds of training; evaluations and stereo are beside them
    int steps = 0, of = 0;     // iterations timed, of those that have every phase in them
    double each = 0;           // seconds of one, mean
    int iterations = 0;        // that the training makes
    bool grows = false;

    /// A line for people, with what it rests on.
    std::string text() const;
};

/// Trains on `scene` for a moment, 40 steps with the schedule squeezed into them and 5 s
/// at most, 20 s where they are slow, and keeps nothing. High leaves room for phases that were not
/// reached. Throws what train() throws.
TimePlan plan_time(const DeviceChoice& device, const Scene& scene, const TrainOptions& options);

}  // namespace tvsgs
