// Runs the experiments of a table: scenes x configurations x seeds, trained, meshed and measured.
#include <spawn.h>
#include <sys/wait.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <map>

#include "apps/eval/subcommands.h"
#include "io/files/read_file.h"
#include "pipeline/run/run_folder.h"

extern char** environ;

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using Words = std::vector<std::string>;

/// Values of "${NAME}" in the texts of a matrix.
using Names = std::map<std::string, std::string>;

std::string line_of(const Words& words) {
    std::string line;
    for (const std::string& word : words) line += " " + word;
    return line;
}

/// Normalises a folder's name, because finished runs are recognised by their flags.
std::string folder_text(const fs::path& folder) {
    const fs::path whole = fs::weakly_canonical(folder);
    return (whole.has_filename() ? whole : whole.parent_path()).string();
}

void append(Words& words, const Words& more) {
    words.insert(words.end(), more.begin(), more.end());
}

/// Runs a tool next to this one; returns its exit code, or 128 + signal.
int run_tool(const std::string& name, const Words& words) {
    spdlog::info("{}{}", name, line_of(words));
    const std::string path = (fs::read_symlink("/proc/self/exe").parent_path() / name).string();
    std::vector<char*> argv{const_cast<char*>(path.c_str())};
    for (const std::string& word : words) argv.push_back(const_cast<char*>(word.c_str()));
    argv.push_back(nullptr);
    pid_t child = 0;
    if (const int code = posix_spawn(&child, path.c_str(), nullptr, nullptr, argv.data(), environ))
        throw Error(ExitCode::io, path, ": cannot start it: ", std::strerror(code));
    int status = 0;
    while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

[[noreturn]] void refuse(const std::string& file, const std::string& what) {
    throw input_error(file, ": ", what,
                      "; expected {\"out\": DIR, \"seeds\": [0], \"scenes\": {NAME: {\"train\": "
                      "[FLAG, ...], \"mesh\": [...], \"eval\": [...]}}, \"configurations\": {NAME: "
                      "[FLAG, ...]}} (docs/guide/evaluation.md)");
}

std::string filled_in(const std::string& file, const std::string& text, const Names& names) {
    std::string out;
    std::size_t at = 0;
    for (std::size_t open; (open = text.find("${", at)) != std::string::npos;) {
        const std::size_t close = text.find('}', open);
        const std::string name =
            close == std::string::npos ? "" : text.substr(open + 2, close - open - 2);
        const auto found = names.find(name);
        if (found == names.end() && name == "data")
            throw usage_error(file, ": '", text, "' needs the folder of the data; give --data DIR");
        if (found == names.end()) {
            std::string known;
            for (const auto& [other, value] : names) known += " " + other;
            refuse(file, str("'", text, "': unknown variable; known are", known));
        }
        out += text.substr(at, open - at) + found->second;
        at = close + 1;
    }
    return out + text.substr(at);
}

Words words_of(const std::string& file,
               const std::string& where,
               const JsonValue& list,
               const Names& names) {
    Words words;
    if (list && !list.is(JsonValue::Kind::list)) refuse(file, where + " is not a list");
    for (const JsonValue& item : list.items) {
        if (!item.is(JsonValue::Kind::text))
            refuse(file, where + " holds a value that is not text");
        words.push_back(filled_in(file, item.text, names));
    }
    return words;
}

/// Names must be valid for folders below "out".
void check_name(const std::string& file, const std::string& what, const std::string& name) {
    if (name.empty() || name == "." || name == ".." || name.find('/') != std::string::npos)
        refuse(file, str(what, " '", name, "' cannot name a folder; remove '/'"));
}

/// One scene of a matrix, with its flags.
struct MatrixScene {
    std::string name;
    Words train, mesh, eval;
};

/// The scenes of one entry: one, or one for each value of its variable.
void add_scenes(const std::string& file,
                const std::string& name,
                const JsonValue& parts,
                const Names& names,
                std::vector<MatrixScene>& scenes) {
    for (const auto& [key, value] : parts.members)
        if (key != "train" && key != "mesh" && key != "eval" && key != "eval_if_there" &&
            key != "for_each")
            refuse(file, str("scene \"", name, "\": unknown key \"", key, "\""));
    std::vector<Names> each = {names};
    if (const JsonValue& loop = parts["for_each"]) {
        if (loop.members.size() != 1)
            refuse(file, "\"for_each\" of " + name + " must hold one list");
        const auto& [variable, values] = loop.members.front();
        const std::string where = str("\"for_each\" of ", name);
        const Words words = words_of(file, where, values, names);
        if (words.empty()) refuse(file, where + " is empty");
        each.clear();
        for (const std::string& value : words) {
            if (std::ranges::count(words, value) > 1)
                refuse(file, str(where, " holds '", value, "' twice"));
            each.push_back(names);
            each.back()[variable] = value;
        }
    }
    for (const Names& with : each) {
        const auto words = [&](const char* key) {
            return words_of(file, str("\"", key, "\" of ", name), parts[key], with);
        };
        MatrixScene scene{filled_in(file, name, with), words("train"), words("mesh"),
                          words("eval")};
        check_name(file, "scene", scene.name);
        if (std::ranges::find(scenes, scene.name, &MatrixScene::name) != scenes.end())
            refuse(file,
                   str("two scenes are named '", scene.name, "'; put the variable into the name"));
        const Words more = words("eval_if_there");
        if (!more.empty() && fs::exists(more.back()))
            append(scene.eval, more);
        else if (!more.empty())
            spdlog::info("{}: no {}; skips {}", scene.name, more.back(), more.front());
        scenes.push_back(std::move(scene));
    }
}

std::vector<std::uint64_t> seeds_of(const std::string& file, const JsonValue& list) {
    if (!list) return {0};
    std::vector<std::uint64_t> seeds;
    for (const JsonValue& seed : list.items) {
        const double number = seed.is(JsonValue::Kind::number) ? seed.number : -1;
        if (!(number >= 0) || number > 1e15 || number != std::floor(number))
            refuse(file, "\"seeds\" holds a value that is not a whole number");
        seeds.push_back(static_cast<std::uint64_t>(number));
        if (std::ranges::count(seeds, seeds.back()) > 1)
            refuse(file, str("\"seeds\" holds ", seeds.back(), " twice; remove one"));
    }
    if (seeds.empty()) refuse(file, "\"seeds\" is not a list of numbers");
    return seeds;
}

/// Whether a run is trained, meshed and measured.
bool complete(const std::string& run, const Words& train, const MatrixScene& scene) {
    const std::string report = run + "/report.json";
    bool done = false;
    if (fs::is_regular_file(report)) {
        const JsonValue json = parse_json_value(read_bytes(report), report);
        done = json["summary"]["event"].text == "done";
        const std::string& line = json["run"]["command_line"].text;
        if (done && line.find(line_of(train)) == std::string::npos)
            throw usage_error(run, ": trained with other flags:\n  ", line,
                              "\nexpected\n  tvsgs-train", line_of(train),
                              "\nGive the matrix another \"out\", or remove the run");
    }
    const auto step = [&](const char* tool, Words words) {
        if (is_quiet()) words.push_back("--quiet");
        const int code = run_tool(tool, words);
        if (code == 130 || code == 143)
            throw Error(static_cast<ExitCode>(code), str(tool, ": stopped by a signal"));
        if (code != 0)
            spdlog::error("{}: {} ended with exit code {}; it is not in the table", run, tool,
                          code);
        return code == 0;
    };
    Words words = train;
    if (fs::is_regular_file(run + "/config.json")) words.push_back("--resume");
    if (!done && !step("tvsgs-train", words)) return false;
    words = {"--model", run};
    append(words, scene.mesh);
    if ((!done || find_mesh(run).empty()) && !step("tvsgs-extract-mesh", words)) return false;
    words = {"run", "--model", run};
    append(words, scene.eval);
    return step("tvsgs-eval", words);
}

}  // namespace

std::vector<std::string> run_matrix(const MatrixOptions& options) {
    const std::string& file = options.file;
    const JsonValue matrix = parse_json_value(read_bytes(file), file);
    for (const auto& [key, value] : matrix.members)
        if (key != "out" && key != "seeds" && key != "scenes" && key != "configurations" &&
            key != "comment")
            refuse(file, "unknown key \"" + key + "\"");
    if (matrix["scenes"].members.empty()) refuse(file, "no \"scenes\"");
    if (matrix["configurations"].members.empty()) refuse(file, "no \"configurations\"");
    if (matrix["out"] && !matrix["out"].is(JsonValue::Kind::text))
        refuse(file, "\"out\" is not text");
    Names names{{"here", folder_text(fs::absolute(file).parent_path())}};
    if (!options.data.empty()) names["data"] = folder_text(options.data);
    const std::string out = filled_in(file, matrix["out"].text_or("runs"), names);
    const std::vector<std::uint64_t> seeds = seeds_of(file, matrix["seeds"]);

    for (const auto& [name, flags] : matrix["configurations"].members) {
        check_name(file, "configuration", name);
        if (name.find('=') != std::string::npos)
            refuse(file, str("configuration '", name, "' has a '='; remove it"));
    }
    std::vector<MatrixScene> scenes;
    for (const auto& [name, parts] : matrix["scenes"].members)
        add_scenes(file, name, parts, names, scenes);
    for (const std::string& wanted : options.scenes)
        if (std::ranges::find(scenes, wanted, &MatrixScene::name) == scenes.end()) {
            std::string known;
            for (const MatrixScene& scene : scenes) known += " " + scene.name;
            throw usage_error("--scenes ", wanted, ": not in ", file, "; it has", known);
        }

    std::vector<std::string> runs;
    for (const std::uint64_t seed : seeds)
        for (const MatrixScene& scene : scenes) {
            if (!options.scenes.empty() &&
                std::ranges::find(options.scenes, scene.name) == options.scenes.end())
                continue;
            for (const auto& [name, flags] : matrix["configurations"].members) {
                const std::string run = str(out, "/", scene.name, "/", name, "/seed_", seed);
                Words train = scene.train;
                append(train, words_of(file, name, flags, names));
                append(train, {"--seed", str(seed), "--out", run});
                if (options.dry_run) {
                    Words mesh{"--model", run}, eval{"run", "--model", run};
                    append(mesh, scene.mesh), append(eval, scene.eval);
                    std::printf("tvsgs-train %s\ntvsgs-extract-mesh %s\ntvsgs-eval %s\n",
                                shell_line(train).c_str(), shell_line(mesh).c_str(),
                                shell_line(eval).c_str());
                    continue;
                }
                if (complete(run, train, scene)) runs.push_back(name + "=" + run);
            }
        }
    return runs;
}

}  // namespace tvsgs
