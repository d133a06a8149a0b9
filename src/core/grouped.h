// Whole numbers as people read them.
#pragma once

#include <cstddef>
#include <string>

namespace tvsgs {

/// With commas between thousands: 1,234,567. For console text and pages, not for files that
/// programs read.
template <class Integer>
std::string grouped(Integer value) {
    std::string text = std::to_string(value);
    const auto first = static_cast<std::ptrdiff_t>(text[0] == '-');
    for (auto at = static_cast<std::ptrdiff_t>(text.size()) - 3; at > first; at -= 3)
        text.insert(static_cast<std::size_t>(at), 1, ',');
    return text;
}

/// "1 face", "2,419 faces".
inline std::string counted(std::size_t count, const std::string& what) {
    return grouped(count) + " " + what + (count == 1 ? "" : "s");
}

}  // namespace tvsgs
