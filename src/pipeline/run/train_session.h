// A training with its run folder: progress, checkpoints, evaluations on the way, the results.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "core/device/device_choice.h"
#include "core/scene/scene.h"
#include "pipeline/run/resume.h"
#include "pipeline/run/run_folder.h"
#include "pipeline/run/run_options.h"

namespace tvsgs {

/// How much a session says and saves on its way; no part of the configuration.
struct SessionOptions {
    int report_every = 50;        // iterations between lines of log.jsonl
    int checkpoint_every = 5000;  // iterations; 0: only when the run is stopped
    bool profile = false;         // seconds per stage in log.jsonl
    double live_every = 0;        // seconds between snapshots for tvsgs-view; 0: none
};

/// What a session is of. References must outlive it.
struct SessionInputs {
    Scene& scene;           // in the end with refined cameras, where they are refined
    TrainOptions training;  // what trains: growth may stop earlier than configured
    RunOptions& options;    // the configuration; takes over the schedule that fits --time-budget
    SessionOptions session;
    const Resume& resume;
    const std::optional<Truth>& truth;
    std::function<std::string()> config;  // the text of config.json, of `options` as they are
    std::function<void()> write_report;   // when all that it tells of is in the run folder
};

/// Trains, and leaves in `run` what docs/guide/commands.md lists; its first files are there. Where
/// the training is stopped, the splats so far and a checkpoint are saved. Throws Error, and Stopped
/// after a signal. `start`: what a resumed training goes on from; given away, it is held no longer
/// than it is needed.
void run_session(const DeviceChoice& device,
                 const SessionInputs& inputs,
                 SharedState start,
                 RunFolder& run);

}  // namespace tvsgs
