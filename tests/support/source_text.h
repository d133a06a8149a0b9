// For tests that read the repository itself.
#pragma once

#include <filesystem>
#include <regex>
#include <string>
#include <vector>

#include "support/command.h"

namespace tvsgs {

inline const std::filesystem::path kSource = TVSGS_SOURCE_DIR;

inline std::vector<std::smatch> matches(const std::string& text, const std::regex& pattern) {
    return {std::sregex_iterator(text.begin(), text.end(), pattern), std::sregex_iterator()};
}

}  // namespace tvsgs
