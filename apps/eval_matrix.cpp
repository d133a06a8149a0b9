#include "eval_matrix.h"

#include <spawn.h>
#include <sys/wait.h>

#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>

#include "common.h"
#include "io/json_value.h"
#include "io/read_file.h"

extern char** environ;

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using Words = std::vector<std::string>;

std::string joined(const Words& words) {
    std::string line;
    for (const std::string& word : words) line += " " + word;
    return line;
}

/// Runs a tool that stands beside this one; its exit code, or 128 + signal.
int run_tool(const std::string& name, const Words& words) {
    spdlog::info("{}{}", name, joined(words));
    const std::string path = (fs::read_symlink("/proc/self/exe").parent_path() / name).string();
    std::vector<char*> argv{const_cast<char*>(path.c_str())};
    for (const std::string& word : words) argv.push_back(const_cast<char*>(word.c_str()));
    argv.push_back(nullptr);
    pid_t child = 0;
    if (const int code = posix_spawn(&child, path.c_str(), nullptr, nullptr, argv.data(), environ))
        throw Error(ExitCode::io, str(path, ": cannot be started: ", std::strerror(code)));
    int status = 0;
    while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

[[noreturn]] void refuse(const std::string& file, const std::string& what) {
    throw Error(ExitCode::input,
                str(file, ": ", what,
                    "; expected {\"out\": DIR, \"seeds\": [0], \"scenes\": {NAME: {\"train\": "
                    "[FLAG, ...], \"mesh\": [...], \"eval\": [...]}}, \"configurations\": {NAME: "
                    "[FLAG, ...]}}"));
}

Words words_of(const std::string& file, const std::string& where, const JsonValue& list) {
    Words words;
    if (list && !list.is(JsonValue::Kind::list)) refuse(file, where + " is no list");
    for (const JsonValue& item : list.items) {
        if (!item.is(JsonValue::Kind::text)) refuse(file, where + " holds what is no text");
        words.push_back(item.text);
    }
    return words;
}

std::vector<std::uint64_t> seeds_of(const std::string& file, const JsonValue& list) {
    if (!list) return {0};
    std::vector<std::uint64_t> seeds;
    for (const JsonValue& seed : list.items) {
        const double number = seed.is(JsonValue::Kind::number) ? seed.number : -1;
        if (!(number >= 0) || number > 1e15 || number != std::floor(number))
            refuse(file, "\"seeds\" holds what is no whole number");
        seeds.push_back(static_cast<std::uint64_t>(number));
    }
    if (seeds.empty()) refuse(file, "\"seeds\" is no list of numbers");
    return seeds;
}

void append(Words& words, const Words& more) {
    words.insert(words.end(), more.begin(), more.end());
}

/// True when it is trained, meshed and measured.
bool complete(const std::string& run, const Words& train, const Words& mesh, const Words& measure) {
    const std::string report = run + "/report.json";
    bool done = false;
    if (fs::is_regular_file(report)) {
        const JsonValue json = parse_json_value(read_bytes(report), report);
        done = json["summary"]["event"].text == "done";
        const std::string& line = json["run"]["command_line"].text;
        if (done && line.find(joined(train)) == std::string::npos)
            throw Error(ExitCode::usage,
                        str(run, ": was trained by\n  ", line, "\nexpected\n  tvsgs-train",
                            joined(train), "\ngive the matrix another \"out\", or remove the run"));
    }
    const auto step = [&](const char* tool, const Words& words) {
        const int code = run_tool(tool, words);
        if (code == 130 || code == 143)
            throw Error(static_cast<ExitCode>(code), str(tool, ": stopped by a signal"));
        if (code != 0)
            spdlog::error("{}: {} ended with exit code {}; the table does without it", run, tool,
                          code);
        return code == 0;
    };
    Words words = train;
    if (fs::is_regular_file(run + "/config.json")) words.push_back("--resume");
    if (!done && !step("tvsgs-train", words)) return false;
    words = {"--model", run};
    append(words, mesh);
    if ((!done || !fs::is_regular_file(run + "/mesh/mesh.ply")) &&
        !step("tvsgs-extract-mesh", words))
        return false;
    words = {"run", "--model", run};
    append(words, measure);
    return step("tvsgs-eval", words);
}

}  // namespace

std::vector<std::string> run_matrix(const std::string& file) {
    const JsonValue matrix = parse_json_value(read_bytes(file), file);
    for (const auto& [key, value] : matrix.members)
        if (key != "out" && key != "seeds" && key != "scenes" && key != "configurations")
            refuse(file, "unknown key \"" + key + "\"");
    const JsonValue &scenes = matrix["scenes"], &configurations = matrix["configurations"];
    if (scenes.members.empty()) refuse(file, "no \"scenes\"");
    if (configurations.members.empty()) refuse(file, "no \"configurations\"");
    if (matrix["out"] && !matrix["out"].is(JsonValue::Kind::text)) refuse(file, "\"out\" is no text");
    const std::string out = matrix["out"].text_or("runs");
    const std::vector<std::uint64_t> seeds = seeds_of(file, matrix["seeds"]);

    std::vector<std::string> runs;
    for (const std::uint64_t seed : seeds)
        for (const auto& [scene, parts] : scenes.members)
            for (const auto& [name, flags] : configurations.members) {
                for (const auto& [key, value] : parts.members)
                    if (key != "train" && key != "mesh" && key != "eval")
                        refuse(file, str("scene \"", scene, "\": unknown key \"", key, "\""));
                const std::string run = str(out, "/", scene, "/", name, "/seed_", seed);
                Words train = words_of(file, "\"train\" of " + scene, parts["train"]);
                append(train, words_of(file, name, flags));
                append(train, {"--seed", str(seed), "--out", run});
                if (complete(run, train, words_of(file, "\"mesh\" of " + scene, parts["mesh"]),
                             words_of(file, "\"eval\" of " + scene, parts["eval"])))
                    runs.push_back(name + "=" + run);
            }
    return runs;
}

}  // namespace tvsgs
