// The training loop.
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
#include "optim/losses/loss.h"
#include "optim/optimiser/adam.h"
#include "optim/optimiser/camera_refinement.h"

namespace tvsgs {

struct ModelOptions {
    int sh_degree = 3;
    int sh_every = 1000;

    template <class Visitor>
    void fields(Visitor& field) {
        field("sh_degree", sh_degree, {0, 3}, "degree of the spherical harmonics");
        field("sh_every", sh_every, {1, 1e9},
              "iterations after which the degree in use rises by one");
    }
};

/// Whether growth spares what the initial cloud covers.
inline bool spares(const DensifyOptions& o) {
    return o.enabled && o.spare_covered > 0;
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
        field("iterations", iterations, {0, 1e9}, "training iterations, a photograph each");
        field("seed", seed, {0, 9e15}, "of all random numbers");
        field("photo_bytes", photo_bytes, {0, 9e15},
              "photographs to hold on the device, bytes; where there are more, they come from the "
              "host while it works, with the same results; 0: all");
        field("backbone", backbone, "the rasteriser: ewa, rade or surfel");
        field.group("model", model, "the Gaussians");
        field.group("render", render, "the rasteriser");
        field.group("lr", lr, "learning rates");
        field.group("loss", loss, "terms of the objective");
        field.group("cameras", cameras, "poses that training improves");
        field.group("densify", densify, "growing and pruning");
        field.group("tv", tv, "tensor voting");
        field.group("init", init, "the first Gaussians");
    }
};

/// Spherical-harmonics degree in use at a step.
inline int sh_degree_at(const ModelOptions& model, int step) {
    return std::min(model.sh_degree, step / model.sh_every);
}

struct TrainReport {
    int step = 0;
    double loss = 0;
    std::vector<std::pair<const char*, double>>
        terms;  // weighted values of this step's view; terms that did not act are 0
    int gaussians = 0;
    MemoryUse memory{};
    std::vector<StageTime> stages;  // cumulative; empty without profiling
};

using SharedState = std::shared_ptr<const State>;

/// How the loop talks to its caller; it never touches files.
struct TrainCallbacks {
    std::function<bool(int step)>
        report_due;  // whether this step is reported: reading the loss waits for the device
    std::function<void(const TrainReport&)> on_report;
    std::function<bool()> stop_requested;  // polled every step; true ends the training early
    std::function<void(int done)> on_end;  // after how many iterations
    bool profile = false;
    bool goes_on = false;  // the caller has trained before: what was logged then is not repeated

    /// save_due: asked before each iteration whether the state after `done` of them is to be saved.
    /// on_save takes it, and also the last state of a training that is stopped or gives up. The
    /// last iteration of a run differs from the others, so a longer run can only go on from a state
    /// before it.
    std::function<bool(int done)> save_due;
    std::function<void(int done, const SharedState& state)> on_save;

    /// Where the poses are refined: whenever they have changed, and once at first.
    std::function<void(const CameraRefinement&)> on_cameras;

    /// Where exposures are fitted: what they are in the end, of scene.train.
    std::function<void(const HeldExposures&)> on_exposures;

    /// The run was rolled back to where it had `done` iterations; `what` says why.
    std::function<void(int done, const std::string& what)> on_rollback;
    InjectedFault injected_fault;
};

/// Called between two steps.
template <class Device>
using AfterStep = std::function<void(int step, const Gaussians<Device>& splats)>;

/// Trains on scene.train and returns the Gaussians on `Device`. The same seed, scene, options and
/// device type give the same bits, also when the training goes on from a saved state, `start`.
///
/// The guard checks losses every step, and all parameters every hundred steps and before they are
/// reported, saved, pruned or returned. The first number that is not finite takes the run back to
/// its last saved state (or its start) and divides the learning rate of the group at fault by ten;
/// the second one is an Error(ExitCode::numerical) that names loss, view, parameter and splat.
template <class Device>
Gaussians<Device> train(const Scene& scene,
                        const TrainOptions& options,
                        const TrainCallbacks& callbacks,
                        const AfterStep<Device>& after_step = {},
                        SharedState start = nullptr);

/// Throws Error(ExitCode::usage) where the poses are to be refined and the rasteriser or the terms
/// have no derivatives by them. train() does so, too.
void check_cameras(const TrainOptions& options, bool backbone_moves_cameras);

/// Iterations that a saved state has behind it.
int iterations_done(const State& state);

/// Throws Error(ExitCode::usage) where a training cannot go on from that state with these options:
/// another degree of harmonics, poses no longer refined, covered parts spared that the state does
/// not know. train() does so, too.
void check_start(const State& start, const TrainOptions& options);

}  // namespace tvsgs
