// Reading of other programs' JSON files. Include it only in sources: the library's header is large.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "io/files/read_file.h"

namespace tvsgs {

/// The JSON of a file; `is_discarded()` if the file is not valid JSON. Throws
/// Error(ExitCode::input) if the nesting is deeper than check_json_depth() allows.
inline nlohmann::json read_json_file(const std::string& path) {
    const auto limit_depth = [&](int depth, nlohmann::json::parse_event_t, nlohmann::json&) {
        check_json_depth(depth, path);
        return true;
    };
    return nlohmann::json::parse(read_bytes(path), limit_depth, /*allow_exceptions=*/false);
}

}  // namespace tvsgs
