// The training loop.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "comm/communicator.h"
#include "comm/options.h"
#include "core/scene.h"
#include "core/stage_clock.h"
#include "core/state.h"
#include "optim/adam.h"
#include "optim/bounds.h"
#include "optim/camera_refinement.h"
#include "optim/densify.h"
#include "optim/init.h"
#include "optim/loss.h"
#include "optim/train_guard.h"

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

/// Where colours and their moments lie. `waiting`: on the device, where steps of splats out of view
/// wait until they are seen, as they always do on the host (optim/waiting_harmonics.h).
enum class KeepHarmonics { device, waiting, host };
inline Memory memory_of(KeepHarmonics keep) {
    return keep == KeepHarmonics::host ? Memory::host : Memory::device;
}

struct OptimOptions {
    KeepHarmonics harmonics = KeepHarmonics::device;
    bool skip_step_on_structure_change = true;

    template <class Visitor>
    void fields(Visitor& field) {
        field.choice("harmonics", harmonics, {"device", "waiting", "host"},
                     "where colours and their moments lie, with the same results; waiting: on the "
                     "GPU, but steps of splats out of view wait until they are seen: faster where "
                     "a view sees a small part of a large scene; host: 576 bytes a splat less of "
                     "the GPU's memory at degree 3; each step then moves those that its view sees "
                     "over the bus and back");
        field("skip_step_on_structure_change", skip_step_on_structure_change,
              "an opacity reset takes that iteration's Adam step of the opacities with it, as in "
              "the official "
              "codes; iterations that change the number of splats never step");
    }
};

/// Whether growth spares what the initial cloud covers.
inline bool spares(const DensifyOptions& o) {
    return o.enabled && o.spare_covered > 0;
}

/// Whether steps of harmonics out of view wait.
inline bool waits(const OptimOptions& o) {
    return o.harmonics != KeepHarmonics::device;
}

struct TrainOptions {
    int iterations = 30000;
    std::int64_t seed = 0, photo_bytes = 0;
    std::string backbone = "ewa";
    ModelOptions model;
    BackboneOptions render;
    AdamOptions lr;
    OptimOptions optim;
    LossOptions loss;
    CameraOptions cameras;
    DensifyOptions densify;
    BoundOptions bounds;
    TvOptions tv;
    InitOptions init;
    CommOptions comm;

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
        field.group("optim", optim, "the optimiser");
        field.group("loss", loss, "terms of the objective");
        field.group("cameras", cameras, "poses that training improves");
        field.group("densify", densify, "growing and pruning");
        field.group("bounds", bounds, "how large and long splats may get");
        field.group("tv", tv, "tensor voting");
        field.group("init", init, "the first Gaussians");
        field.group("comm", comm, "photographs of a step, and processes that share them");
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

    /// The other processes of this training, at most TrainOptions::comm.batch in all; null: none.
    /// All have the same scene, options, start and answers of these callbacks. The photographs of a
    /// step are dealt to them; gradients, values of losses, statistics of growth and what terms
    /// learn are gathered and added in the order of the photographs. So all have the same splats,
    /// those that one process would have.
    Communicator* peers = nullptr;
    int records_at_a_time = 0;  // see StepBatch
};

/// The splats after the step, asked for by who looks at them: some of it may have waited, or be
/// with other processes. So of several processes all have to ask after the same steps.
template <class Device>
using SplatsNow = std::function<const Gaussians<Device>&()>;
/// Called between two steps.
template <class Device>
using AfterStep = std::function<void(int step, const SplatsNow<Device>& splats_now)>;

/// Trains on scene.train and returns the Gaussians on `Device`. The same seed, scene, options and
/// device type give the same bits, also when the training goes on from a saved state, `start`, and
/// for any number of processes. Of these each keeps its part of what changes from step to step but
/// for the parameters: on_save gives it its part of the state (comm/state_parts.h), and `start` may
/// be such a part or the whole.
///
/// A step looks at comm.batch photographs, and iterations count these. It goes along the mean of
/// their gradients; events are due at the step whose photographs they fall among. A round of the
/// views leaves out, by draw, those that do not fill a step.
///
/// Losses are looked at every step, all parameters every hundred and before anything is reported,
/// saved, pruned or returned; harmonics on the host, or that are with other processes, every
/// thousand, and not for reports, but where something else is at fault. The first
/// number that is not finite takes the run back to its last saved state (or its start) and divides
/// the learning rate of what went wrong by ten; the second one is an Error(ExitCode::numerical)
/// that names loss, view, parameter and splat.
template <class Device>
Gaussians<Device> train(const Scene& scene,
                        const TrainOptions& options,
                        const TrainCallbacks& callbacks,
                        const AfterStep<Device>& after_step = {},
                        SharedState start = nullptr);

/// Throws Error(ExitCode::usage) where the poses are to be refined and the rasteriser or the terms
/// have no derivatives by them. train() does so, too.
void check_cameras(const TrainOptions& options, bool backbone_moves_cameras);

/// Why harmonics cannot wait, or lie on the host: a step would want all of them. Empty where they
/// can. `fuses`: of the rasteriser.
std::string why_harmonics_stay(const Scene& scene, const TrainOptions& options, bool fuses);

/// Throws Error(ExitCode::usage) where they are to wait all the same. train() does so, too.
void check_harmonics(const Scene& scene, const TrainOptions& options, bool fuses);

/// As check_harmonics(), but where they are to wait on the device and cannot, none does: another
/// run's configuration may ask for it, and the results are the same. Returns why; else nothing.
std::string settle_harmonics(const Scene& scene, TrainOptions& options);

/// Throws Error(ExitCode::usage) where there are more processes than photographs of a step, or a
/// term keeps what one process alone knows.
void check_ranks(const TrainOptions& options, int ranks);

/// Throws Error(ExitCode::usage) where a step would look at more photographs than there are,
/// and as check_ranks(). train() does so, too.
void check_batch(const Scene& scene, const TrainOptions& options, int ranks);

/// Iterations that a saved state has behind it.
int iterations_done(const State& state);

/// Throws Error(ExitCode::usage) where a training cannot go on from that state with these options:
/// another degree of harmonics, poses no longer refined, covered parts spared that the state does
/// not know. train() does so, too.
void check_start(const State& start, const TrainOptions& options);

}  // namespace tvsgs
