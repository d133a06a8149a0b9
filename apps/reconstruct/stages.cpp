#include "apps/reconstruct/stages.h"

#include <poll.h>

#include <algorithm>
#include <numeric>
#include <regex>

#include "apps/common/command_line.h"
#include "core/error.h"
#include "core/progress.h"
#include "core/version.h"
#include "io/files/atomic_file.h"
#include "io/files/json_value.h"
#include "io/files/read_file.h"
#include "pipeline/run/signals.h"

namespace tvsgs::reconstruct {
namespace {

namespace fs = std::filesystem;

/// "1:02:03" -> 3723; NaN for an empty text.
double seconds_of(const std::string& clock) {
    double seconds = clock.empty() ? NAN : 0, part = 0;
    for (const char c : clock + ":") {
        if (c != ':') part = 10 * part + (c - '0');
        if (c == ':') seconds = 60 * seconds + std::exchange(part, 0);
    }
    return seconds;
}

}  // namespace

const StageKind kPrepare{"prepare",
                         "Cameras",
                         "tvsgs-prepare",
                         35,
                         {{"features", 0, 0.4},
                          {"exhaustive", 0.4, 0.6},
                          {"sequential", 0.4, 0.6},
                          {"transitive", 0.4, 0.6},
                          {"poses", 0.6, 1}}};
const StageKind kTrain{"train", "Training", "tvsgs-train", 50, {{"stereo", 0, 0.3}, {"", 0.3, 1}}};
const StageKind kMesh{"mesh",
                      "Mesh",
                      "tvsgs-extract-mesh",
                      13,
                      {{"depth maps", 0, 0.5}, {"check", 0.5, 0.7}, {"texture", 0.7, 1}}};
const StageKind kView{"view", "Page", "tvsgs-view", 2, {}};

void StageProgress::read(std::string_view line, double seconds) {
    constexpr std::size_t kLongest = 300;  // a longer line is no progress
    // Lines of core/progress.h and of pipeline/run/progress.h.
    static const std::regex kWork(
        R"((.+) [\d:]+ \[[#.]+\] (\d+) %(?:  (about|more than) ([\d:]+) left)?)");
    static const std::regex kTraining(
        R"(( *)(\d+) %  \d+/\d+  [\d:]+(?:, (about|more than) ([\d:]+) left)?.*)");
    const std::string text(line.substr(0, kLongest));
    std::smatch m;
    const bool training = std::regex_match(text, m, kTraining);
    if (!training && !std::regex_match(text, m, kWork)) return;
    work_ = training ? "" : m.str(1);
    const double left = seconds_of(m.str(4));
    ends_at_ = seconds + left, is_lower_bound_ = m.str(3) == "more than";
    for (const Part& part : kind_.parts)
        if (training ? part.work.empty() : !part.work.empty() && work_.starts_with(part.work))
            share_ = std::max(share_, part.begin + (part.end - part.begin) *
                                                       std::min(std::stod(m.str(2)) / 100, 1.0));
}

double StageProgress::left(double seconds) const {
    return seconds < ends_at_ ? ends_at_ - seconds : NAN;
}

StageRunner::StageRunner(std::vector<const StageKind*> stages, const std::string& log)
    : stages_(std::move(stages)), log_(log), begin_(steady_seconds()), shown_(begin_) {}

StageRunner::End StageRunner::run(const StageKind& kind, const std::vector<std::string>& command) {
    const double begin = steady_seconds();
    log_.add("\n" + shell_line(command));
    ChildProcess child({.words = command, .environment = {}, .own_group = true});
    StageProgress progress(kind);
    LastMessage message;
    int sent = 0;
    for (;;) {
        show(kind, progress);
        pollfd wanted{child.output(), POLLIN, 0};
        poll(&wanted, 1, child.output() < 0 ? 5 : 200);  // ms; without output it is ending
        const std::optional<int> code = child.exit_code();
        child.read_lines([&](std::string_view line) {
            log_.add(line);
            message.add(line);
            progress.read(line, steady_seconds());
            warnings_ += line.starts_with("warning:");
        });
        if (code) {
            end_progress_line();
            return {*code, message.text(), steady_seconds() - begin};
        }
        if (sent != 0 || SignalGuard::received() == 0) continue;
        sent = SignalGuard::received();
        child.send(sent);
    }
}

void StageRunner::show(const StageKind& kind, const StageProgress& progress) {
    constexpr double kInPlace = 0.2, kPlain = 10;  // seconds between lines
    const double now = steady_seconds();
    if (progress_style() == ProgressStyle::quiet ||
        now - shown_ < (progress_in_place() ? kInPlace : kPlain))
        return;
    shown_ = now;
    show_progress_line(whole_text(stages_, kind, progress, now - begin_, now));
}

std::string whole_text(const std::vector<const StageKind*>& stages,
                       const StageKind& kind,
                       const StageProgress& progress,
                       double seconds,
                       double now) {
    const auto at = std::ranges::find(stages, &kind);
    const auto add = [](double sum, const StageKind* stage) { return sum + stage->weight; };
    const double all = std::accumulate(stages.begin(), stages.end(), 0.0, add),
                 done = std::accumulate(stages.begin(), at, kind.weight * progress.share(), add);
    const double left = progress.left(now);
    return progress_text(str(kind.title, ", ", at - stages.begin() + 1, " of ", stages.size(),
                             progress.work().empty() ? "" : ", ", progress.work()),
                         seconds, done / all, left, progress.is_lower_bound()) +
           (std::isfinite(left) ? " in this step" : "");
}

Record::Record(const fs::path& folder) : file_((folder / "reconstruct.json").string()) {
    if (!fs::exists(file_)) return;
    const JsonValue json = parse_json_value(read_text(file_), file_);
    if (!json["version"].text.starts_with("tvsgs ") || !json["stages"].is(JsonValue::Kind::list))
        throw input_error(file_, ": not a file of tvsgs-reconstruct; choose another folder");
    for (const JsonValue& stage : json["stages"].items)
        stages_.push_back({stage["name"].text, stage["command"].text, stage["done"].number != 0});
    is_new_ = false;
}

const Record::Stage* Record::find(const std::string& name) const {
    const auto found = std::ranges::find(stages_, name, &Stage::name);
    return found == stages_.end() ? nullptr : &*found;
}

bool Record::is_done(const std::string& name) const {
    const Stage* const stage = find(name);
    return stage != nullptr && stage->done;
}

void Record::clear() {
    stages_.clear();
    save();
}

void Record::start(const std::string& name, const std::string& command) {
    stages_.erase(std::ranges::find(stages_, name, &Stage::name), stages_.end());
    stages_.push_back({name, command});
    save();
}

void Record::finish(const std::string& name) {
    std::ranges::find(stages_, name, &Stage::name)->done = true;
    save();
}

void Record::save() const {
    JsonValue stages = JsonValue::list();
    for (const Stage& stage : stages_)
        stages.items.push_back(JsonValue()
                                   .add("name", stage.name)
                                   .add("command", stage.command)
                                   .add("done", stage.done));
    write_text_file(file_,
                    json_text(JsonValue().add("version", kVersion).add("stages", stages)) + "\n");
}

}  // namespace tvsgs::reconstruct
