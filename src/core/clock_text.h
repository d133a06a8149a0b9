// Seconds as a clock shows them.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

namespace tvsgs {

/// 65 -> "1:05".
inline std::string clock_text(double seconds) {
    const auto total = static_cast<long>(std::lround(std::min(seconds, 1e9)));
    char text[48];
    if (total >= 3600)
        std::snprintf(text, sizeof text, "%ld:%02ld:%02ld", total / 3600, total / 60 % 60,
                      total % 60);
    else
        std::snprintf(text, sizeof text, "%ld:%02ld", total / 60, total % 60);
    return text;
}

}  // namespace tvsgs
