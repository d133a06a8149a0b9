// The stages of a reconstruction: each runs one program, logs its output and shows its progress.
#pragma once

#include <cmath>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "pipeline/run/child_process.h"

namespace tvsgs::reconstruct {

/// A piece of a stage's work with a progress of its own.
struct Part {
    std::string_view work;  // how its name begins; empty: the iterations of a training
    double begin, end;      // rough shares of the stage
};

struct StageKind {
    std::string name, title, program;
    double weight;  // rough duration, in units of the others
    std::vector<Part> parts;
};

extern const StageKind kPrepare, kTrain, kMesh, kView;

/// Progress of a stage, from the progress lines of its program.
class StageProgress {
public:
    explicit StageProgress(const StageKind& kind) : kind_(kind) {}

    /// Reads a line that the program wrote at `seconds`. Ignores lines without progress.
    void read(std::string_view line, double seconds);

    double share() const { return share_; }  // 0 to 1, never decreasing
    double left(double seconds) const;       // of the present piece of work; NaN: unknown
    bool is_lower_bound() const { return is_lower_bound_; }  // left() is
    const std::string& work() const { return work_; }        // empty: unnamed

private:
    const StageKind& kind_;
    std::string work_;
    double share_ = 0, ends_at_ = NAN;  // ends_at_: of the present piece of work, seconds
    bool is_lower_bound_ = false;
};

class StageRunner {
public:
    /// `stages`: all of them, in their order. `log`: file that receives the output.
    StageRunner(std::vector<const StageKind*> stages, const std::string& log);

    struct End {
        int code;             // exit code, or 128 + N after signal N
        std::string message;  // the program's last message
        double seconds;
    };
    /// Runs a stage's command. Passes the first signal of a SignalGuard to the program.
    End run(const StageKind& kind, const std::vector<std::string>& command);

    int warnings() const { return warnings_; }  // of all programs

private:
    void show(const StageKind& kind, const StageProgress& progress);

    std::vector<const StageKind*> stages_;
    LineLog log_;
    double begin_, shown_;
    int warnings_ = 0;
};

/// OUT/reconstruct.json: the stages of a reconstruction with their command lines.
class Record {
public:
    struct Stage {
        std::string name, command;
        bool done = false;
    };

    /// Reads the record in `folder`, if there is one. Throws Error(ExitCode::input) if it is
    /// damaged or not ours.
    explicit Record(const std::filesystem::path& folder);

    bool is_new() const { return is_new_; }            // the folder has no record
    const Stage* find(const std::string& name) const;  // null: not started
    bool is_done(const std::string& name) const;

    // Each writes the file.
    void clear();
    /// Forgets the stage and all that were started after it.
    void start(const std::string& name, const std::string& command);
    void finish(const std::string& name);

private:
    void save() const;

    std::string file_;
    std::vector<Stage> stages_;  // in the order of their starts
    bool is_new_ = true;
};

/// The line of progress for the stage `kind` of `stages`. `seconds`: since the first began; `now`:
/// by the clock of StageProgress.
std::string whole_text(const std::vector<const StageKind*>& stages,
                       const StageKind& kind,
                       const StageProgress& progress,
                       double seconds,
                       double now);

}  // namespace tvsgs::reconstruct
