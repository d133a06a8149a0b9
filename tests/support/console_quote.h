// Compares the console output that a page quotes with the output of the program.
#pragma once

#include <regex>
#include <sstream>
#include <string>
#include <vector>

#include "support/source_text.h"

namespace tvsgs::test {

/// The lines of the text blocks of docs/guide/start.md, with # for numbers and for levels of
/// quality, as they vary.
inline std::string without_numbers(const std::string& text) {
    static const std::regex kVaries(R"(\d[\d.,:]*|\b(good|fair|poor)\b)");
    return std::regex_replace(std::regex_replace(text, kVaries, "#"), std::regex("components"),
                              "component");
}

inline std::vector<std::string> console_quotes() {
    std::vector<std::string> lines;
    std::istringstream in(contents(kSource / "docs/guide/start.md"));
    bool quoted = false;
    for (std::string line; std::getline(in, line);)
        if (line.starts_with("```"))
            quoted = line == "```text";
        else if (quoted)
            lines.push_back(without_numbers(line));
    return lines;
}

/// The first quoted line that begins with `begin` and that the output lacks; empty: none.
inline std::string missing_quote(const std::string& output, const std::string& begin) {
    const std::string said = without_numbers(output);
    bool found = false;
    for (const std::string& line : console_quotes()) {
        if (!line.starts_with(begin)) continue;
        found = true;
        if (said.find(line) == std::string::npos) return line;
    }
    return found ? "" : "a line that begins with " + begin;
}

}  // namespace tvsgs::test
