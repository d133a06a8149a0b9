// Common parts of all commands: options, and the conversion of exceptions to messages and exit
// codes.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <initializer_list>
#include <string>

#include "core/error.h"
#include "core/log.h"
#include "core/version.h"

namespace tvsgs {

/// Requires a number above 0.
extern const CLI::Validator kPositive;

/// Requires a number in a range; unlike CLI::Range, rejects NaN.
CLI::Validator in_range(double low, double high);

/// Parses options, with '_' and '-' alike in long names; the last value of a repeated option wins.
/// Errors become Error(ExitCode::usage); an unknown option names the nearest one. Adds and answers
/// --version, --help and --help-all, and for programs --help-man (the manual) and --help-words (for
/// completion), which must come last.
void parse_command_line(CLI::App& app, int argc, char* const* argv);

/// An option for an output file. Refuses to replace files that tvsgs did not write, before any work
/// is done.
CLI::Option* add_output_flag(CLI::App& app,
                             const std::string& names,
                             std::string& file,
                             const std::string& description);

/// Quotes a word for a shell if necessary.
std::string for_shell(const std::string& word);

/// The last message of a command: "Next, `what`:" and, alone on its line, the command to type,
/// quoted for a shell.
void say_next(std::initializer_list<std::string> words, const std::string& what);

/// Runs a command; every exception ends as one message on standard error and the exit code of its
/// kind.
int run_command(const std::function<int()>& command);

}  // namespace tvsgs
