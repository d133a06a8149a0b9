// What a command says about its flags: to people, to man and to the shell; all from its CLI::App.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace tvsgs {

/// The flags of most days where there are many (--help-all has the others), all where there are
/// few.
std::string help_page(CLI::App& app);

/// In the format of man(7), section 1, of every flag and subcommand.
std::string man_page(const CLI::App& app);

/// One line for each word that may follow: subcommands and long flags; after a flag that takes a
/// value, a tab and what it may be: choices, or nothing where files are expected.
std::string completion_words(const CLI::App& app);

}  // namespace tvsgs
