// Runs the installed COLMAP. Its own help decides how its options are named.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace tvsgs::prepare {

/// Path of the COLMAP program. Throws Error(ExitCode::usage) that names the package.
std::string find_colmap();

/// Names without "--", as in COLMAP 4, and values.
using ColmapOptions = std::vector<std::pair<std::string, std::string>>;

class Colmap {
public:
    /// Asks the program for its version. `log` receives the output of all commands, a file in
    /// `work` the help.
    Colmap(std::string program, const std::filesystem::path& work, std::string log);

    /// The version, such as "3.8"; "?" if the program's help has none.
    const std::string& version() const { return version_; }

    /// Command line with the names that `colmap COMMAND -h` lists: an option in a Feature group, or
    /// the same option in the Sift group of older versions. Asks once per command. Throws
    /// Error(ExitCode::usage) if neither is listed.
    std::vector<std::string> command(const std::string& name, const ColmapOptions& options);

    /// Runs a command line. Passes each line to `on_line`, without glog's prefix, and an empty line
    /// every 200 ms or more often. Returns the exit code.
    int run(const std::vector<std::string>& command,
            const std::function<void(std::string_view)>& on_line) const;

    /// The same. Throws Error(ExitCode::input) unless the exit code is 0.
    void require(const std::vector<std::string>& command,
                 const std::function<void(std::string_view)>& on_line) const;

    /// Throws Error(ExitCode::input) with the last lines of the log.
    [[noreturn]] void fail(const std::vector<std::string>& command, int code) const;

private:
    std::vector<std::string> ask(const std::vector<std::string>& words) const;
    std::string name_of(const std::string& command, const std::string& option);

    std::string program_, log_, help_log_, version_ = "?";
    std::map<std::string, std::set<std::string>> listed_;  // options by command
};

/// The text of a line of the log after glog's prefix, "I20251107 12:00:00.123456 77 sfm.cc:12] ".
std::string_view message_of(std::string_view line);

/// The number after `before` in a message.
std::optional<std::size_t> number_after(std::string_view text, std::string_view before);

/// Share of the matching that is done after a message; 0 for other messages. After a part:
/// "Matching block [2/3, 1/3] in 0.5s" or "Matching image [5/24] in 0.5s"; newer versions write
/// "Matching block [2/3, 1/3]" or "Processing image [5/24]" before it.
double share_of_matches(std::string_view text);

/// Share of the photographs that have a pose or points after a message; 0 for other messages:
/// "Registering image #6 (3)", newer "Registering image #6 (num_reg_frames=2)", or "Triangulating
/// image #6 (2)".
double share_of_poses(std::string_view text, std::size_t photographs);

}  // namespace tvsgs::prepare
