// The training loop.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "core/scene.h"
#include "core/stage_clock.h"
#include "optim/adam.h"
#include "optim/densify.h"
#include "optim/init.h"
#include "optim/loss.h"

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

struct OptimOptions {
    bool skip_step_on_structure_change = true;

    template <class Visitor>
    void fields(Visitor& field) {
        field("skip_step_on_structure_change", skip_step_on_structure_change,
              "an opacity reset takes that iteration's Adam step of the opacities with it, as in "
              "the official "
              "codes; iterations that change the number of splats never step");
    }
};

struct TrainOptions {
    int iterations = 30000;
    std::int64_t seed = 0;
    std::string backbone = "3dgs";
    ModelOptions model;
    BackboneOptions core;
    AdamOptions lr;
    OptimOptions optim;
    LossOptions loss;
    DensifyOptions densify;
    TvOptions tv;
    InitOptions init;

    template <class Visitor>
    void fields(Visitor& field) {
        field("iterations", iterations, {0, 1e9}, "training iterations");
        field("seed", seed, {0, 9e15}, "of all random numbers");
        field("backbone", backbone, "3dgs or pgsr");
        field.group("model", model, "the Gaussians");
        field.group("core", core, "the rasteriser");
        field.group("lr", lr, "learning rates");
        field.group("optim", optim, "the optimiser");
        field.group("loss", loss, "terms of the objective");
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

/// How the loop talks to its caller; it never touches files.
struct TrainCallbacks {
    std::function<bool(int step)>
        report_due;  // whether this step is reported: reading the loss waits for the device
    std::function<void(const TrainReport&)> on_report;
    std::function<bool()> stop_requested;  // polled every step; true ends the training early
    bool profile = false;
};

/// Looks at the splats after a step, wherever they live, between two steps.
template <class Device>
using AfterStep = std::function<void(int step, const Gaussians<Device>& gaussians)>;

/// Trains on scene.train and returns the Gaussians on `Device`. The same seed, scene, options and
/// device type give the same bits. Throws Error(ExitCode::numerical) when a reported loss is not
/// finite, naming the term.
template <class Device>
Gaussians<Device> train(const Scene& scene,
                        const TrainOptions& options,
                        const TrainCallbacks& callbacks,
                        const AfterStep<Device>& after_step = {});

}  // namespace tvsgs
