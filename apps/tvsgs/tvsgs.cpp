// tvsgs: runs the other commands. `tvsgs train ...` runs the tvsgs-train next to it.
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>

#include "apps/common/build_info.h"
#include "apps/common/command_line.h"
#include "core/nearest_name.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kPrefix = "tvsgs-";

std::string short_name(const CommandEntry& entry) {
    return entry.name + kPrefix.size();
}

const CommandEntry& entry_of(const std::string& name) {
    std::vector<std::string> names{"help"};
    for (const CommandEntry& entry : built_commands()) {
        if (name == entry.name || name == short_name(entry)) return entry;
        names.push_back(short_name(entry));
    }
    const std::string near = nearest_name(name, names);
    throw usage_error("tvsgs ", name, ": unknown command",
                      near.empty() ? "" : str("; did you mean ", near, "?"),
                      "; `tvsgs help` lists all");
}

/// Replaces this process by a command with the arguments `words`.
[[noreturn]] void become(const CommandEntry& entry, const std::vector<std::string>& words) {
    const fs::path program = fs::read_symlink("/proc/self/exe").parent_path() / entry.name;
    std::vector<char*> arguments{const_cast<char*>(entry.name)};
    for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
    arguments.push_back(nullptr);
    execv(program.c_str(), arguments.data());
    if (errno == ENOENT)
        throw usage_error(program.string(), ": not installed; install the ", "package ",
                          entry.package);
    throw Error(ExitCode::io, str(program.string(), ": cannot run it: ", std::strerror(errno)));
}

}  // namespace

int command(int argc, char** argv) {
    CLI::App app{"Photographs in, Gaussian splats and accurate surfaces out.", "tvsgs"};
    for (const CommandEntry& entry : built_commands())
        app.add_subcommand(short_name(entry), entry.summary);
    app.add_subcommand("help", "show the flags of a command: tvsgs help train");
    const std::vector<std::string> words(argv + 1, argv + argc);
    const bool listed = words.empty() || (words[0] == "help" && words.back() == "help");
    char list[] = "--help";
    char* const ask_for_list[] = {argv[0], list};
    if (listed) parse_command_line(app, 2, ask_for_list);
    if (words[0].starts_with("-")) {
        parse_command_line(app, argc, argv);
        throw usage_error("no command given; `tvsgs help` lists all");
    }
    if (words[0] == "help") become(entry_of(words[1]), {"--help"});
    become(entry_of(words[0]), {words.begin() + 1, words.end()});
}

}  // namespace tvsgs
