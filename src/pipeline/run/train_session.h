// A training with its run folder: progress, checkpoints, evaluations, results.
#pragma once

#include <functional>
#include <optional>

#include "core/device/device_choice.h"
#include "core/scene/scene.h"
#include "pipeline/run/checkpoints.h"
#include "pipeline/run/run_folder.h"
#include "pipeline/run/run_options.h"

namespace tvsgs {

/// How often a session reports and saves; no part of the configuration.
struct SessionOptions {
    int report_every = 50;        // iterations between lines of log.jsonl
    int checkpoint_every = 5000;  // iterations; 0: only when the run is stopped
    bool profile = false;         // seconds per stage in log.jsonl
    double live_every = 0;        // seconds between snapshots for tvsgs-view; 0: none
    bool for_blocks = false;      // a part of tvsgs-blocks, which continues it
};

/// References must outlive the session.
struct SessionInputs {
    Scene& scene;                 // gets the refined cameras, if they are refined
    const TrainOptions training;  // with the limit of growth that fits into memory
    const RunOptions& options;    // as configured
    const SessionOptions& session;
    const Resume& resume;
    const std::optional<Truth>& truth;
    const JsonValue info;                // "info" of config.json
    std::function<void()> write_report;  // called when the run folder is complete
};

/// Trains, and adds the files of docs/guide/commands.md to the run folder. A stopped training saves
/// its splats and a checkpoint. Throws Error, and Stopped after a signal. `start`: the state to
/// continue from; the session frees it as soon as the training has loaded it.
void run_session(const DeviceChoice& device,
                 const SessionInputs& inputs,
                 SharedState start,
                 RunFolder& run);

}  // namespace tvsgs
