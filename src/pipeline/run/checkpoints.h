// Writes and reads checkpoints in RUN/checkpoints/, and resumes a run from one (--resume).
// docs/develop/reliability.md
#pragma once

#include <future>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/scene/scene.h"
#include "io/config/config.h"
#include "optim/loop/train.h"
#include "pipeline/run/run_folder.h"

namespace tvsgs {

/// A checkpoint in memory.
struct ResumePoint {
    std::string file;
    std::string run;  // its run folder; empty: the checkpoint file was given directly
    SharedState state;
    int done = 0;        // iterations done
    double seconds = 0;  // of training
    std::string config;  // resolved, as JSON
};

/// Opens a checkpoint. `place`: a checkpoint, or a run folder, whose newest valid checkpoint is
/// used. Returns nothing when the folder has none. Throws Error(ExitCode::input) when all of its
/// checkpoints are invalid.
std::optional<ResumePoint> open_checkpoint(const std::string& place);

/// Gives the scene the initial points and extent of the checkpoint. Throws Error(ExitCode::input)
/// when the training views differ; warns when the photographs differ.
void restore_scene(const ResumePoint& point, Scene& scene);

/// Removes checkpoints beyond iteration `done`, which open_checkpoint() would take for the newest.
void remove_checkpoints_after(const std::string& run, int done);

/// Key and value of every option, in the order of the table.
std::vector<std::pair<std::string, std::string>> config_values(const OptionTable& table);
/// Keys whose value differs from `before` (earlier result of config_values()), as a JSON object
/// {"key": "before -> now"}.
JsonValue changed_values(const std::vector<std::pair<std::string, std::string>>& before,
                         const OptionTable& table);

/// Writes checkpoints in the background and keeps the newest two of a run. A failed write only
/// warns: older checkpoints stay, and the training continues.
class CheckpointWriter {
public:
    /// `scene` must outlive it.
    CheckpointWriter(std::string run, std::string config, const Scene& scene)
        : run_(std::move(run)), config_(std::move(config)), scene_(scene) {}
    ~CheckpointWriter() { finish(); }

    void save(int done, double seconds, const SharedState& state);

    void set_run(std::string run) { run_ = std::move(run); }

    /// Sets the text to store in later checkpoints.
    void set_config(std::string config) { config_ = std::move(config); }

    /// Waits for the last write; returns its file, or nothing when it failed.
    std::optional<std::string> finish();

    /// Why the last write failed.
    const std::string& failure() const { return failure_; }

private:
    std::string run_, config_;
    const Scene& scene_;
    std::optional<std::uint32_t> photos_;
    std::string file_, failure_;
    std::future<std::string> writing_;  // returns the error of the write
};

struct Resume {
    bool asked = false;                // --resume was given
    bool same_run = false;             // the checkpoint lies in the run folder
    std::optional<ResumePoint> point;  // absent: no checkpoint yet, so start from the beginning
    std::vector<std::pair<std::string, std::string>> configured;  // configuration of the checkpoint

    /// Whether the run continues in its own folder, whose files are kept.
    bool in_place() const { return asked && same_run; }

    // Work done before this call.
    int done() const { return point ? point->done : 0; }  // iterations
    double seconds() const { return point ? point->seconds : 0; }
};

/// Finds the checkpoint. `given`: a run folder or a checkpoint; empty: the folder `out`. Sets an
/// empty `out` to the checkpoint's run. Reads the configuration of the run into `table`. Throws
/// Error.
Resume open_resume(const std::string& given, std::string& out, OptionTable& table);

/// Whether open_resume() found a configuration of the run in `out`.
bool is_configured(const Resume& resume, const std::string& out);

/// Throws Error(ExitCode::usage) if the checkpoint has done all iterations, if its splats belong to
/// another rasteriser, and if there is none in a run `out` with splats, which a new start would
/// remove without `overwrite`.
void check_resume(const Resume& resume,
                  const std::string& out,
                  bool overwrite,
                  const TrainOptions& train);

/// Logs where the run resumes. `changed`: changed options, see changed_values(). Removes
/// checkpoints of iterations that are done again.
void log_resume(const Resume& resume, const JsonValue& changed, RunFolder& run);

}  // namespace tvsgs
