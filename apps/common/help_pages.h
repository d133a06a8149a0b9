// Help, manual and completion words of a command, from its CLI::App.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace tvsgs {

std::vector<const CLI::App*> subcommands_of(const CLI::App& app);

/// Sets how the help of `app` shows names, types and limits; call it before help_page().
void use_help_format(CLI::App& app);

/// Help with the common flags if there are many (--help-all shows the others), else with all.
std::string help_page(CLI::App& app);

/// Manual of every flag and subcommand, in the format of man(7), section 1.
std::string man_page(const CLI::App& app);

/// One line per possible word: subcommands and long flags. A flag with a value has a tab and its
/// choices, or nothing after the tab for files.
std::string completion_words(const CLI::App& app);

}  // namespace tvsgs
