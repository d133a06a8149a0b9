#include "apps/prepare/colmap.h"

#include <poll.h>
#include <unistd.h>

#include <cctype>
#include <cstdlib>
#include <deque>
#include <fstream>
#include <iterator>
#include <sstream>

#include "core/error.h"
#include "io/files/read_file.h"
#include "pipeline/run/child_process.h"
#include "pipeline/run/signals.h"

namespace tvsgs::prepare {
namespace {

bool is_digit(char c) {
    return std::isdigit(static_cast<unsigned char>(c)) != 0;
}

/// Runs `command` without display and input. Appends its output to the file `log` and passes each
/// line to `on_line`, and an empty line every 200 ms or more often. Returns its exit code, or 128 +
/// the signal that ended it. Throws Stopped if a SignalGuard has noted a signal, after the program
/// has ended. Throws Error(ExitCode::io) if the log cannot be written or no process can be made.
int run_program(const std::vector<std::string>& command,
                const std::string& log,
                const std::function<void(std::string_view)>& on_line) {
    LineLog file(log);
    std::string shown = "\n$";
    for (const std::string& word : command) shown += " " + word;
    file.add(shown);
    ChildProcess child({command, {"QT_QPA_PLATFORM=offscreen", "TERM=dumb"}});  // no colours
    for (;;) {
        SignalGuard::check();
        pollfd wanted{child.output(), POLLIN, 0};
        // ms: a signal may arrive between check and poll; without output the program is ending.
        poll(&wanted, 1, child.output() < 0 ? 5 : 200);
        const std::optional<int> code = child.exit_code();
        child.read_lines([&](std::string_view line) {
            file.add(line);
            on_line(line);
        });
        on_line({});
        if (!code) continue;
        SignalGuard::check();  // the program may have received the same signal
        return *code;
    }
}

/// The last lines of a file, for messages.
std::string last_lines(const std::string& file, int count) {
    std::ifstream in(file);
    std::deque<std::string> lines;
    for (std::string line; std::getline(in, line);) {
        if (line.find_first_not_of(" \t=") == std::string::npos) continue;
        lines.push_back(line);
        if (lines.size() > static_cast<std::size_t>(count)) lines.pop_front();
    }
    std::string out;
    for (const std::string& line : lines) out += "\n  " + line;
    return out;
}

}  // namespace

std::string find_colmap() {
    const char* const path = std::getenv("PATH");
    std::istringstream folders(path ? path : "/usr/bin:/bin");
    for (std::string folder; std::getline(folders, folder, ':');) {
        const std::string file = (folder.empty() ? "." : folder) + "/colmap";
        if (access(file.c_str(), X_OK) == 0) return file;
    }
    throw Error(ExitCode::usage,
                "COLMAP not found; install it (apt-get install colmap) or put it on the PATH");
}

Colmap::Colmap(std::string program, const std::filesystem::path& work, std::string log)
    : program_(std::move(program)), log_(std::move(log)), help_log_((work / "help.log").string()) {
    // "COLMAP 3.8 -- Structure-from-Motion and Multi-View Stereo"
    const std::vector<std::string> words = ask({"help"});
    for (std::size_t i = 1; i < words.size() && version_ == "?"; ++i)
        if (words[i - 1] == "COLMAP" && is_digit(words[i][0])) version_ = words[i];
    LineLog(log_).add("COLMAP " + version_ + ", " + program_);
}

std::vector<std::string> Colmap::ask(const std::vector<std::string>& words) const {
    std::vector<std::string> command = {program_}, answer;
    command.insert(command.end(), words.begin(), words.end());
    const int code = run_program(command, help_log_, [&](std::string_view line) {
        std::istringstream in{std::string(line)};
        answer.insert(answer.end(), std::istream_iterator<std::string>(in), {});
    });
    if (code > 125)  // not started, or ended by a signal
        throw Error(ExitCode::usage, program_, ": does not start, exit code ", code, ":",
                    last_lines(help_log_, 3));
    return answer;
}

std::string Colmap::name_of(const std::string& command, const std::string& option) {
    if (!listed_.contains(command))
        for (const std::string& word : ask({command, "-h"}))
            if (word.starts_with("--")) listed_[command].insert(word.substr(2));
    const std::set<std::string>& listed = listed_[command];
    if (listed.contains(option)) return option;
    // Up to 3.12: SiftExtraction and SiftMatching. 3.13 has moved some of their options, 4 all.
    const std::string newer = "Feature",
                      older = option.starts_with(newer) ? "Sift" + option.substr(newer.size()) : "";
    if (listed.contains(older)) return older;
    throw Error(ExitCode::usage,
                str(program_, ": COLMAP ", version_, " does not list the option --", option,
                    older.empty() ? "" : " or --" + older, " in 'colmap ", command,
                    " -h'; put a COLMAP between 3.8 and 4.1 first on the PATH"));
}

std::vector<std::string> Colmap::command(const std::string& name, const ColmapOptions& options) {
    std::vector<std::string> words = {program_, name};
    for (const auto& [option, value] : options)
        words.insert(words.end(), {"--" + name_of(name, option), value});
    return words;
}

int Colmap::run(const std::vector<std::string>& command,
                const std::function<void(std::string_view)>& on_line) const {
    return run_program(command, log_, [&](std::string_view line) { on_line(message_of(line)); });
}

void Colmap::require(const std::vector<std::string>& command,
                     const std::function<void(std::string_view)>& on_line) const {
    if (const int code = run(command, on_line); code != 0) fail(command, code);
}

void Colmap::fail(const std::vector<std::string>& command, int code) const {
    throw input_error("colmap ", command.at(1), " failed (exit code ", code, "); last lines of ",
                      log_, ":", last_lines(log_, 6));
}

std::string_view message_of(std::string_view line) {
    const std::size_t end = line.find("] ");
    const bool prefixed = end != std::string_view::npos && line.size() > 1 &&
                          std::string_view("IWEF").find(line[0]) != std::string_view::npos &&
                          is_digit(line[1]);
    return trimmed(prefixed ? line.substr(end + 2) : line);
}

std::optional<std::size_t> number_after(std::string_view text, std::string_view before) {
    const std::size_t at = text.find(before);
    if (at == std::string_view::npos) return std::nullopt;
    text = trimmed(text.substr(at + before.size()));
    std::size_t number = 0;
    return parse_number(text.substr(0, text.find_first_not_of("0123456789")), number)
               ? std::optional(number)
               : std::nullopt;
}

double share_of_matches(std::string_view text) {
    const auto part = number_after(text, "["), parts = number_after(text, "/");
    if (!text.starts_with("Matching") && !text.starts_with("Processing")) return 0;
    if (!part || !parts || *part == 0 || *parts == 0) return 0;
    const auto column = number_after(text, ", ");
    const std::size_t number = column ? (*part - 1) * *parts + *column : *part,
                      all = column ? *parts * *parts : *parts;
    const bool done = text.find(" in ") != std::string_view::npos;
    return (static_cast<double>(number) - (done ? 0 : 1)) / static_cast<double>(all);
}

double share_of_poses(std::string_view text, std::size_t photographs) {
    if (!text.starts_with("Registering image") && !text.starts_with("Triangulating image"))
        return 0;
    const auto frames = number_after(text, "num_reg_frames="), count = number_after(text, "(");
    return static_cast<double>(frames ? *frames : count.value_or(0)) /
           static_cast<double>(photographs);
}

}  // namespace tvsgs::prepare
