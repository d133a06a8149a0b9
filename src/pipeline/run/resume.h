// --resume: the run that goes on, and from where.  docs/develop/reliability.md
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
    bool same_run = false;             // the run folder is the checkpoint's
    std::optional<ResumePoint> point;  // nothing: no checkpoint yet, so from the beginning
    std::vector<std::pair<std::string, std::string>> configured;  // what the checkpoint ran with

    /// Whether the run goes on in its own folder, whose files are kept.
    bool in_place() const { return asked && same_run; }

    // What the run has behind it.
    int done() const { return point ? point->done : 0; }  // iterations
    double seconds() const { return point ? point->seconds : 0; }
};

/// Finds the checkpoint: `given` is a run folder or a checkpoint, or empty for the folder `out`,
/// which becomes the checkpoint's run where it is empty. What the run was configured as goes into
/// `table`. Throws Error.
Resume open_resume(const std::string& given, std::string& out, OptionTable& table);

/// Whether open_resume() found what the run in `out` was configured as.
bool is_configured(const Resume& resume, const std::string& out);

/// Throws Error(ExitCode::usage) where --resume has found no checkpoint in a run that has splats,
/// which starting anew would remove. `out`: its folder.
void require_nothing_lost(const Resume& resume, const std::string& out);

/// Throws Error(ExitCode::usage) unless the checkpoint leaves some of so many iterations to do.
void require_iterations_left(const Resume& resume, int iterations);

/// Throws Error(ExitCode::usage) where the checkpoint's splats are another rasteriser's.
void require_same_backbone(const Resume& resume, const std::string& backbone);

/// Says and logs where the run goes on. `changed`: of the configuration, see changed_values().
/// Checkpoints of iterations that are done anew are removed.
void log_resume(const Resume& resume, const JsonValue& changed, RunFolder& run);

}  // namespace tvsgs
