// tvsgs-blocks status: shows which blocks are waiting, training, done or damaged.
#include <cstdio>
#include <filesystem>
#include <memory>

#include "apps/blocks/subcommands.h"
#include "io/files/json_value.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

struct StatusArguments {
    std::string folder;
    bool missing = false, json = false;
};

/// The last iteration in a log; 0: none yet.
int last_iteration(const std::string& log) {
    std::error_code code;
    if (!fs::is_regular_file(log, code)) return 0;
    int iteration = 0;
    for (const JsonValue& line : parse_json_lines(read_bytes(log), log, [](const std::string&) {}))
        iteration = int(line["iteration"].number_or(iteration));
    return iteration;
}

struct BlockState {
    std::string state, text;
    double splats = 0, seconds = 0;
    int iteration = 0;
};

BlockState state_of(const BlocksManifest& manifest, int block) {
    BlockState s;
    const std::string folder = manifest.block_folder(block);
    try {
        read_block_inputs(manifest, block);
        if (const auto done = read_block_result(manifest, block)) {
            s.splats = double(done->splats), s.seconds = done->seconds;
            s.state = "done", s.text = str(done->splats, " splats, ", done->seconds, " s");
            return s;
        }
    } catch (const Error& error) {
        s.state = "damaged", s.text = error.what();
        return s;
    }
    s.iteration = last_iteration(folder + "/run/log.jsonl");
    const std::string at = str("iteration ", s.iteration);
    if (FolderLock(folder).held())
        s.state = "training", s.text = at;
    else if (s.iteration > 0)
        s.state = "stopped", s.text = at;
    else
        s.state = "waiting";
    return s;
}

int status(const StatusArguments& a) {
    const BlocksManifest manifest = read_manifest(a.folder);
    std::vector<int> missing;
    JsonValue list = JsonValue::list();
    for (int block = 1; block <= manifest.count(); ++block) {
        const BlockState s = state_of(manifest, block);
        if (s.state != "done") missing.push_back(block);
        if (a.json) {
            JsonValue entry = JsonValue::object();
            entry.set("block", double(block));
            entry.set("state", s.state);
            entry.set("iteration", double(s.iteration));
            entry.set("splats", s.splats), entry.set("seconds", s.seconds);
            entry.set("text", s.text);
            list.items.push_back(std::move(entry));
        } else if (!a.missing) {
            const std::string state =
                s.text.empty() ? s.state : fmt::format("{:9} {}", s.state, s.text);
            std::printf("block %-4d %s\n", block, state.c_str());
        }
    }
    if (a.json) std::printf("%s\n", json_text(list).c_str());
    if (a.missing && !missing.empty()) std::printf("%s\n", block_list(missing).c_str());
    if (missing.empty() && !a.missing && !a.json)
        say_next({"tvsgs-blocks", "merge", a.folder, "--out", "RUN"}, "merge them");
    return missing.empty() ? 0 : int(ExitCode::input);
}

}  // namespace

Subcommand add_blocks_status(CLI::App& app) {
    const auto a = std::make_shared<StatusArguments>();
    CLI::App* const command = app.add_subcommand(
        "status", "print the state of each block: waiting, training, stopped, done or damaged");
    add_blocks_folder(*command, a->folder);
    const auto missing = command->add_flag(
        "--missing", a->missing, "print only the numbers of unfinished blocks, such as 3,7-9");
    command->add_flag("--json", a->json, "print JSON")->excludes(missing);
    return {command, [a] { return status(*a); }};
}

}  // namespace tvsgs
