// Options and entry points of training.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/scene/scene.h"
#include "core/scene/state.h"
#include "core/stage_clock.h"
#include "optim/growth/densify.h"
#include "optim/growth/init.h"
#include "optim/loop/train_guard.h"
#include "optim/losses/losses_list.h"
#include "optim/optimiser/adam.h"
#include "optim/optimiser/camera_refinement.h"

namespace tvsgs {

struct ModelOptions {
    int sh_degree = 3;
    int sh_every = 1000;
    float longest_axis = 0;

    template <class Visitor>
    void fields(Visitor& field) {
        field("sh_degree", sh_degree, {0, 3},
              "degree of the SH coefficients; 0: no view-dependent colour");
        field("sh_every", sh_every, {1, 1e9},
              "iterations after which the SH degree in use rises by one");
        field("longest_axis", longest_axis, {0, 1e6},
              "largest axis of a splat, in multiples of the second largest; 0: no limit");
    }
};

/// Whether growth leaves out splats in areas that the initial cloud covers.
inline bool grows_in_gaps_only(const DensifyOptions& o) {
    return o.enabled && o.growth_in_gaps_only > 0;
}

struct TrainOptions {
    int iterations = 30000;
    std::int64_t seed = 0, photo_bytes = 0;
    std::string backbone = "ewa";
    ModelOptions model;
    BackboneOptions render;
    AdamOptions lr;
    LossOptions loss;
    CameraOptions cameras;
    DensifyOptions densify;
    TvOptions tv;
    InitOptions init;

    template <class Visitor>
    void fields(Visitor& field) {
        field("iterations", iterations, {0, 1e9}, "training iterations, one photograph each");
        field("seed", seed, {0, 9e15}, "seed of all random numbers");
        field("photo_bytes", photo_bytes, {0, 9e15},
              "photographs to keep on the device, bytes; others stay on the host; 0: all");
        field("backbone", backbone, "rasteriser: ewa, rade or surfel");
        field.group("model", model, "the Gaussians");
        field.group("render", render, "the rasteriser");
        field.group("lr", lr, "learning rates");
        field.group("loss", loss, "loss terms");
        field.group("cameras", cameras, "poses that training improves");
        field.group("densify", densify, "growing and pruning");
        field.group("tv", tv, "tensor voting");
        field.group("init", init, "the first Gaussians");
    }
};

/// Degree of the SH coefficients in use at a step.
inline int sh_degree_at(const ModelOptions& model, int step) {
    return std::min(model.sh_degree, step / model.sh_every);
}

struct TrainReport {
    int step = 0;
    double loss = 0;
    // Weighted values for this step's view; 0 for terms that did not act.
    std::vector<std::pair<std::string, double>> terms;
    int gaussians = 0;
    MemoryUse memory{};
    std::vector<StageTime> stages;  // cumulative; empty without profiling
};

using SharedState = std::shared_ptr<const State>;

/// Functions that the training loop calls; the loop itself never touches files.
struct TrainCallbacks {
    // Whether to report this step; reading the loss waits for the device.
    std::function<bool(int step)> report_due;
    std::function<void(const TrainReport&)> on_report;
    std::function<bool()> stop_requested;  // polled every step; true ends the training early
    std::function<void(int done)> on_end;  // called with the number of iterations done
    bool profile = false;
    bool goes_on = false;  // the caller has trained before: do not log the setup again

    /// save_due: whether to save the state after `done` iterations; called before each iteration.
    /// on_save gets that state, also the last one of a training that is stopped or fails. The last
    /// iteration of a run differs, so a longer run has to resume from an earlier state.
    std::function<bool(int done)> save_due;
    std::function<void(int done, const SharedState& state)> on_save;

    /// Called when poses are refined: once at the start and after each change.
    std::function<void(const CameraRefinement&)> on_cameras;

    /// Called at the end when exposures are fitted, with the exposures of scene.train.
    std::function<void(const HeldExposures&)> on_exposures;

    /// Called after a rollback to iteration `done`; `what` gives the reason.
    std::function<void(int done, const std::string& what)> on_rollback;
    InjectedFault injected_fault;
};

/// Called between two steps.
template <class Device>
using AfterStep = std::function<void(int step, const Gaussians<Device>& splats)>;

/// Trains on scene.train and returns the Gaussians on `Device`. The same seed, scene, options and
/// device type give the same bits, also when the training resumes from a saved state `start`.
///
/// The guard checks losses every step, and all parameters every hundred steps and before they are
/// reported, saved, pruned or returned. At the first number that is not finite it restores the last
/// saved state (or the start) and divides the learning rate of the faulty parameter group by ten;
/// the second one throws Error(ExitCode::numerical), which names loss, view, parameter and splat.
template <class Device>
Gaussians<Device> train(const Scene& scene,
                        const TrainOptions& options,
                        const TrainCallbacks& callbacks,
                        const AfterStep<Device>& after_step = {},
                        SharedState start = nullptr);

/// Throws Error(ExitCode::usage) when poses are to be refined without derivatives by them.
void check_cameras(const TrainOptions& options, bool has_camera_gradient);

/// Throws Error(ExitCode::usage) when options of supported splats do not fit the rasteriser or each
/// other. `before_plan`: the plan may still set init.support.
void check_support(const TrainOptions& options,
                   const BackboneTraits& backbone,
                   bool before_plan = false);

int iterations_done(const State& state);

/// Throws Error(ExitCode::usage) when a training with these options cannot resume from that state.
void check_start(const State& start, const TrainOptions& options);

}  // namespace tvsgs
