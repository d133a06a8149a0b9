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

/// Two digits; numbers from 10 on as whole numbers.
inline std::string short_figure(double value) {
    char text[32];
    std::snprintf(text, sizeof text, value >= 9.95 && value < 1e10 ? "%.0f" : "%.2g", value);
    return text;
}
/// "33 %".
inline std::string percent(double share) {
    return short_figure(100 * share) + " %";
}
/// "63 MB", "20.3 GB".
inline std::string bytes_text(double bytes) {
    const bool large = bytes >= 1e9;
    char text[32];
    std::snprintf(text, sizeof text, large ? "%.1f GB" : "%.0f MB", bytes / (large ? 1e9 : 1e6));
    return text;
}

/// The text that sets an option.
inline std::string rounded(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.5g", value);
    return text;
}

}  // namespace tvsgs
