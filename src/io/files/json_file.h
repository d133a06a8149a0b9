// Parsing of other programs' JSON. Include it only in sources: the library's header is large.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "io/files/read_file.h"

namespace tvsgs {

/// JSON of a text; `is_discarded()` if it is not valid. Throws Error(ExitCode::input) that names
/// `where` if the nesting is deeper than check_json_depth() allows.
inline nlohmann::json parse_json(std::string_view text, const std::string& where) {
    const auto limit_depth = [&](int depth, nlohmann::json::parse_event_t, nlohmann::json&) {
        check_json_depth(depth, where);
        return true;
    };
    return nlohmann::json::parse(text, limit_depth, /*allow_exceptions=*/false);
}

}  // namespace tvsgs
