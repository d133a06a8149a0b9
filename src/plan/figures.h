// Numbers as the plan writes them.
#pragma once

#include <cmath>
#include <cstdio>
#include <string>

namespace tvsgs {

inline std::string printed(const char* format, double value) {
    char text[32];
    std::snprintf(text, sizeof text, format, value);
    return text;
}

/// Three digits; whole numbers in full.
inline std::string number(double value) {
    const bool whole = value == std::floor(value) && std::abs(value) < 1e10;
    return printed(whole ? "%.10g" : "%.3g", value);
}
/// Two digits; numbers from 10 on as whole numbers.
inline std::string short_figure(double value) {
    return printed(value >= 9.95 && value < 1e10 ? "%.0f" : "%.2g", value);
}
/// "33 %".
inline std::string percent(double share) {
    return short_figure(100 * share) + " %";
}
/// "63 MB", "20.3 GB".
inline std::string bytes_text(double bytes) {
    return bytes >= 1e9 ? printed("%.1f GB", bytes / 1e9) : printed("%.0f MB", bytes / 1e6);
}
/// The text that sets an option.
inline std::string rounded(double value) {
    return printed("%.5g", value);
}

}  // namespace tvsgs
