// Common parts of all commands: options, and the conversion of exceptions to messages and exit
// codes.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>
#include <type_traits>
#include <vector>

#include "core/error.h"
#include "core/log.h"
#include "core/version.h"

namespace tvsgs {

/// An error in the command line or a configuration.
template <class... Parts>
Error usage_error(const Parts&... parts) {
    return Error(ExitCode::usage, parts...);
}

/// Requires a number above 0.
extern const CLI::Validator kPositive;

/// Requires a number in a range; unlike CLI::Range, rejects NaN.
CLI::Validator in_range(double low, double high);

template <class Number>
CLI::Option* add_number(CLI::App& app,
                        const std::string& names,
                        Number& value,
                        std::type_identity_t<Number> low,
                        std::type_identity_t<Number> high,
                        const std::string& description) {
    CLI::Option* const option = app.add_option(names, value, description);
    if constexpr (std::is_floating_point_v<Number>)
        return option->check(in_range(low, high));
    else
        return option->check(CLI::Range(low, high));
}

CLI::Option* add_choice(CLI::App& app,
                        const std::string& names,
                        std::string& value,
                        const std::vector<std::string>& choices,
                        const std::string& description);

/// Parses options, with '_' and '-' alike in long names; the last value of a repeated option wins.
/// Errors become Error(ExitCode::usage); an unknown option names the nearest one. Adds and answers
/// --version, --help and --help-all, and for programs --help-man (the manual) and --help-words (for
/// completion), which must come last.
void parse_command_line(CLI::App& app, int argc, char* const* argv);

/// Puts the flags added from here on under a heading of the help.
void start_group(CLI::App& app, const std::string& heading);

/// An option that may be given several times, with one value each.
CLI::Option* add_repeated(CLI::App& app,
                          const std::string& names,
                          std::vector<std::string>& values,
                          const std::string& description);

/// Starts the log, and adds --quiet and, if `most` is verbose, -v,--verbose, which change it.
void add_log_flags(CLI::App& app, Verbosity most = Verbosity::normal);
/// Whether --quiet was given.
bool is_quiet();
/// --progress: auto, plain or json; --quiet wins.
void choose_progress_style(const std::string& name);

/// An option for an output file. Refuses to replace files that tvsgs did not write, before any work
/// is done.
CLI::Option* add_output_flag(CLI::App& app,
                             const std::string& names,
                             std::string& file,
                             const std::string& description);

/// Quotes a word for a shell if necessary.
std::string for_shell(const std::string& word);
/// The words as a command line, each quoted for a shell.
std::string shell_line(const std::vector<std::string>& words);

/// The last message of a command: "Next, `what`:" and, alone on its line, the command to type.
void say_next(const std::vector<std::string>& words, const std::string& what);

/// A subcommand, and the function to run if it is chosen; it returns the exit code.
struct Subcommand {
    CLI::App* app;
    std::function<int()> run;
};

/// Adds --quiet (and --verbose) to each subcommand, parses, and runs the chosen one.
int run_subcommand(CLI::App& app,
                   const std::vector<Subcommand>& subcommands,
                   Verbosity most,
                   int argc,
                   char* const* argv);

/// Runs a command; every exception ends as one message on standard error and the exit code of its
/// kind.
int run_command(const std::function<int()>& command);

/// The program's work. Each program defines this function; main() of apps/common calls it.
int command(int argc, char** argv);

}  // namespace tvsgs
