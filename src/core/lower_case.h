// Lower case of ASCII text: extensions of files, keys, names of projections.
#pragma once

#include <cctype>
#include <string>
#include <string_view>

namespace tvsgs {

inline std::string lower_case(std::string_view text) {
    std::string out(text);
    for (char& c : out) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return out;
}

}  // namespace tvsgs
