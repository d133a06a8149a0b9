// Reading whole files and numbers; what all readers share.
#pragma once

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <system_error>

#include "core/error.h"

namespace tvsgs {

/// Throws Error(ExitCode::input) for a folder, and for what may have no end or keep one waiting, as
/// /dev/zero or a pipe.
void require_regular_file(const std::string& path);

/// The whole of a regular file. Throws Error(ExitCode::input) when there is none or it is larger
/// than `limit` bytes, Error(ExitCode::io) when reading fails.
std::string read_bytes(const std::string& path,
                       std::uintmax_t limit = std::numeric_limits<std::uintmax_t>::max());

inline constexpr std::uintmax_t kMaxTextBytes = 1 << 26;  // of what people write: settings, lists

/// The same for text: without the byte order mark that some editors put before it.
std::string read_text(const std::string& path,
                      std::uintmax_t limit = std::numeric_limits<std::uintmax_t>::max());

/// For parsers of files that may be damaged or hostile, whose depth would use up the stack: throws
/// Error(ExitCode::input) that names `where` beyond 64 levels.
void check_json_depth(int depth, const std::string& where);

/// An error in what the user gave us.
template <class... Parts>
Error input_error(const Parts&... parts) {
    return Error(ExitCode::input, str(parts...));
}

/// The whole of `text` as a number, whatever the locale; false when anything is left over or the
/// number does not fit.
template <class Number>
bool parse_number(std::string_view text, Number& number) {
    if (text.size() > 1 && text[0] == '+' && text[1] != '-') text.remove_prefix(1);
    const auto result = std::from_chars(text.data(), text.data() + text.size(), number);
    return result.ec == std::errc{} && result.ptr == text.data() + text.size();
}

inline std::string_view trimmed(std::string_view text) {
    const auto first = text.find_first_not_of(" \t\r\n");
    if (first == std::string_view::npos) return {};
    return text.substr(first, text.find_last_not_of(" \t\r\n") - first + 1);
}

/// What of a file may be shown in a message: its first 40 characters, '?' for what is no text.
inline std::string shown(std::string_view text) {
    std::string out(text.substr(0, 40));
    for (char& c : out)
        if (static_cast<unsigned char>(c) < 32 || static_cast<unsigned char>(c) > 126) c = '?';
    return out;
}

/// Takes the next word off the front of `text`; empty when there is none.
inline std::string_view next_word(std::string_view& text) {
    text.remove_prefix(std::min(text.find_first_not_of(" \t\r\n"), text.size()));
    const std::string_view word = text.substr(0, text.find_first_of(" \t\r\n"));
    text.remove_prefix(word.size());
    return word;
}

}  // namespace tvsgs
