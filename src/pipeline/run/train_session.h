// Runs a training with its run folder: progress, checkpoints, evaluations, results.
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

/// Frequency of output of a session; not part of the configuration.
struct SessionOptions {
    int report_every = 50;        // iterations between lines of log.jsonl
    int checkpoint_every = 5000;  // iterations; 0: only when the run is stopped
    bool profile = false;         // seconds per stage in log.jsonl
    double live_every = 0;        // seconds between snapshots for tvsgs-view; 0: none
};

/// Inputs of a session; referenced objects must outlive it.
struct SessionInputs {
    Scene& scene;           // receives the refined cameras at the end
    TrainOptions training;  // training options; growth may stop earlier than configured
    RunOptions& options;    // the configuration; receives the schedule fitted to --time-budget
    SessionOptions session;
    const Resume& resume;
    const std::optional<Truth>& truth;
    std::function<std::string()> config;  // text of config.json for the present `options`
    std::function<void()> write_report;   // called when all other results are written
};

/// Trains, and writes to `run` the files listed in docs/guide/commands.md, except its first files,
/// which exist already. When stopped, saves the splats so far and a checkpoint. Throws Error, and
/// Stopped after a signal. `start`: state of a resumed training; passed by value, so that it is
/// freed early.
void run_session(const DeviceChoice& device,
                 const SessionInputs& inputs,
                 SharedState start,
                 RunFolder& run);

}  // namespace tvsgs
