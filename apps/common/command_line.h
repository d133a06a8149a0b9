// What all commands share: flags, and one place where exceptions become messages and exit codes.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <initializer_list>
#include <string>

#include "core/error.h"
#include "core/log.h"
#include "core/version.h"

namespace tvsgs {

/// For flags that ask for a number above 0.
extern const CLI::Validator kPositive;

/// For flags that ask for a number: unlike CLI::Range takes no NaN.
CLI::Validator in_range(double low, double high);

/// Parses with '_' and '-' alike in long flags; of a flag given twice the last counts. Errors
/// become Error(ExitCode::usage); an unknown flag names the nearest one. Adds --version, --help and
/// --help-all, and answers them; so, too, what is meant for programs: --help-man (the manual) and
/// --help-words (for completion), which have to stand last.
void parse_command_line(CLI::App& app, int argc, char* const* argv);

/// A flag for a file to write, which may replace none but ours: said before any work is done.
CLI::Option* add_output_flag(CLI::App& app,
                             const std::string& names,
                             std::string& file,
                             const std::string& description);

/// The word as a shell takes it: in quotes where it needs them.
std::string for_shell(const std::string& word);

/// The last message of a command: the line to type next, quoted for a shell, and what it does.
void say_next(std::initializer_list<std::string> words, const std::string& what);

/// Runs a command; every exception ends as one message on standard error and the exit code of its
/// kind.
int run_command(const std::function<int()>& command);

}  // namespace tvsgs
