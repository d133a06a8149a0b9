// Resumes a run from a checkpoint (--resume).  docs/develop/reliability.md
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "io/config/config.h"
#include "pipeline/run/checkpoints.h"
#include "pipeline/run/run_folder.h"

namespace tvsgs {

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
