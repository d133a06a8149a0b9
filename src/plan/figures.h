// Numbers as the plan writes them.
#pragma once

#include <cmath>
#include <cstdio>
#include <string>

namespace tvsgs {

/// Three digits; whole numbers in full.
inline std::string number(double value) {
    char text[32];
    const bool whole = value == std::floor(value) && std::abs(value) < 1e10;
    std::snprintf(text, sizeof text, "%.*g", whole ? 10 : 3, value);
    return text;
}

/// The text that sets an option.
inline std::string rounded(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.5g", value);
    return text;
}

}  // namespace tvsgs
