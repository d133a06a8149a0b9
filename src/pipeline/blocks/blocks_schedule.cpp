#include "pipeline/blocks/blocks_schedule.h"

#include <poll.h>

#include <algorithm>
#include <csignal>
#include <deque>
#include <memory>
#include <optional>

#include "core/error.h"
#include "core/log.h"
#include "core/progress.h"
#include "pipeline/run/signals.h"

namespace tvsgs {
namespace {

constexpr int kTick = 200;  // ms between checks of signals and processes

/// The process of a block and its output.
class Run {
public:
    Run(const BlockJob& job, const ChildProcess::Command& command)
        : job_(job), log_(job.log), begin_(steady_seconds()), process_(command) {
        std::string line = "$";
        for (const std::string& word : command.words) line += " " + word;
        log_.add(line);
    }

    const BlockJob& job() const { return job_; }
    ChildProcess& process() { return process_; }

    /// Reads progress lines from the process; copies other lines to the log.
    void read(const BlockSchedule& schedule) {
        process_.read_lines([&](std::string_view line) {
            if (read_report(line, schedule)) return;
            log_.add(line);
            message_.add(line);
        });
    }

    BlockProgress progress(const std::string& place) const {
        return {job_.block, place, steady_seconds() - begin_, iteration_ / job_.iterations,
                pace_.left(job_.iterations)};
    }

    std::string message() const { return message_.text(); }

private:
    bool read_report(std::string_view line, const BlockSchedule& schedule) {
        if (!line.starts_with("{\"iteration\"")) return false;
        try {
            const JsonValue report = parse_json_value(std::string(line), job_.log);
            iteration_ = report["iteration"].number_or(0);
            pace_.add(steady_seconds() - begin_, iteration_);
            schedule.on_report(job_.block, report);
            return true;
        } catch (const Error&) {  // the process ended within a line
            return false;
        }
    }

    BlockJob job_;
    LineLog log_;
    double begin_, iteration_ = 0;
    ProgressRate pace_;
    LastMessage message_;
    ChildProcess process_;
};

struct Place {
    std::string name;
    std::unique_ptr<Run> run;
    bool usable = true;
};

struct Waiting {
    BlockJob job;
    std::string failed_on;  // place of the first failure
};

class Scheduler {
public:
    Scheduler(const std::vector<BlockJob>& jobs, const BlockSchedule& schedule)
        : schedule_(schedule), jobs_(jobs.size()) {
        for (const BlockJob& job : jobs) waiting_.push_back({job, ""});
        for (const std::string& name : schedule.places) places_.push_back({name, nullptr});
    }

    std::vector<BlockFailure> run() {
        train_waiting();
        alone_ = true;
        waiting_.swap(failed_);
        train_waiting();
        return failed_twice_;
    }

private:
    /// Throws Stopped.
    void train_waiting() {
        while (!waiting_.empty() || running() > 0) {
            for (Place& place : places_)
                if (stopped_by_ == 0 && is_free(place) && !waiting_.empty()) start_next(place);
            show();
            wait_for_output();
            for (Place& place : places_)
                if (place.run) look_at(place);
            pass_signal_on();
            if (stopped_by_ == 0 || running() > 0) continue;
            spdlog::info("{} of {} blocks are done; the same command continues with the rest",
                         done_, jobs_);
            throw Stopped{stopped_by_};
        }
    }

    int running() const {
        return int(std::ranges::count_if(places_, [](const Place& place) { return !!place.run; }));
    }

    bool is_free(const Place& place) const {
        if (place.run || !place.usable) return false;
        if (!alone_) return true;
        const auto other = [&](const Place& p) {
            return p.usable && p.name != waiting_.front().failed_on;
        };
        return running() == 0 && (other(place) || std::ranges::none_of(places_, other));
    }

    void start_next(Place& place) {
        const BlockJob job = waiting_.front().job;
        waiting_.pop_front();
        try {
            place.run =
                std::make_unique<Run>(job, schedule_.command(job.block, place.name, alone_));
            spdlog::info("Block {} starts on {}; messages: {}", job.block, place.name, job.log);
        } catch (const Error& error) {
            fail(job, place, int(error.code()), error.what());
        }
    }

    void show() const {
        std::vector<BlockProgress> progress;
        for (const Place& place : places_)
            if (place.run) progress.push_back(place.run->progress(place.name));
        schedule_.show(progress, done_, int(waiting_.size()));
    }

    void wait_for_output() {
        std::vector<pollfd> wanted;
        for (Place& place : places_)
            if (place.run) wanted.push_back({place.run->process().output(), POLLIN, 0});
        if (!wanted.empty()) poll(wanted.data(), wanted.size(), kTick);
    }

    void look_at(Place& place) {
        std::optional<int> code;
        std::string lines;
        try {
            code = place.run->process().exit_code();
            place.run->read(schedule_);
            lines = place.run->message();
        } catch (const Error& error) {  // the log cannot be written
            code = int(error.code()), lines = error.what();
        }
        if (!code) return;
        const std::unique_ptr<Run> run = std::move(place.run);
        if (*code == 0)
            spdlog::info("Block {} is done, {} of {}", run->job().block, ++done_, jobs_);
        else if (stopped_by_ == 0 && SignalGuard::received() == 0)
            fail(run->job(), place, *code, lines);
    }

    void fail(const BlockJob& job, Place& place, int code, const std::string& lines) {
        const std::string text =
            str("Block ", job.block, " failed ", alone_ ? "again " : "", "on ", place.name, ", ",
                ending_text(code), lines.empty() ? "" : ": ", printable(lines));
        const auto usable = [](const Place& p) { return p.usable; };
        if (code == int(ExitCode::device) && std::ranges::count_if(places_, usable) > 1)
            place.usable = false;
        if (alone_) {
            spdlog::error("{}", text);
            failed_twice_.push_back({job.block, code});
        } else {
            spdlog::warn("{}\n  It runs once more, alone, after the others{}", text,
                         place.usable ? "" : str("; ", place.name, " is no longer used"));
            failed_.push_back({job, place.name});
        }
    }

    void pass_signal_on() {
        if (stopped_by_ != 0 || SignalGuard::received() == 0) return;
        stopped_by_ = SignalGuard::received();
        spdlog::info("Stopping: {} blocks save checkpoints; a second Ctrl-C ends them at once",
                     running());
        for (Place& place : places_)
            if (place.run) place.run->process().send(stopped_by_);
    }

    const BlockSchedule& schedule_;
    std::vector<Place> places_;
    std::deque<Waiting> waiting_, failed_;
    std::vector<BlockFailure> failed_twice_;
    std::size_t jobs_;
    int done_ = 0, stopped_by_ = 0;
    bool alone_ = false;
};

}  // namespace

std::vector<BlockFailure> run_blocks(const std::vector<BlockJob>& jobs,
                                     const BlockSchedule& schedule) {
    const SignalGuard guard;
    return Scheduler(jobs, schedule).run();
}

}  // namespace tvsgs
