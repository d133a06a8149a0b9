// Helpers shared by all readers: whole files, numbers and words.
#pragma once

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <system_error>

#include "core/error.h"

namespace tvsgs {

/// True for a regular file that exists.
bool is_file(const std::filesystem::path& path);

/// Throws Error(ExitCode::input) for a folder, and for a path that may block or never end, such as
/// a pipe or /dev/zero.
void require_regular_file(const std::string& path);

/// A file open for reading. Throws like require_regular_file(), and if it cannot be opened.
using OpenFile = std::unique_ptr<std::FILE, int (*)(std::FILE*)>;
OpenFile open_file(const std::string& path);

/// Throws Error(ExitCode::io) if reading `file` has failed.
void check_read(const OpenFile& file, const std::string& path);

/// Reads a whole regular file. Throws Error(ExitCode::input) if there is none or it has more than
/// `limit` bytes, and Error(ExitCode::io) if reading fails.
std::string read_bytes(const std::string& path,
                       std::uintmax_t limit = std::numeric_limits<std::uintmax_t>::max());

inline constexpr std::uintmax_t kMaxTextBytes = 1 << 26;  // of hand-written files: settings, lists

/// The same for text. Removes the byte order mark that some editors write at the beginning.
std::string read_text(const std::string& path,
                      std::uintmax_t limit = std::numeric_limits<std::uintmax_t>::max());

/// Limits the depth of JSON from damaged or hostile files, which could exhaust the stack. Throws
/// Error(ExitCode::input) that names `where` beyond 64 levels.
void check_json_depth(int depth, const std::string& where);

/// An error in the user's input.
template <class... Parts>
Error input_error(const Parts&... parts) {
    return Error(ExitCode::input, parts...);
}

/// Parses all of `text` as a number, independent of the locale. Returns false if characters remain
/// or the number does not fit.
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

/// The entries with commas between them.
template <class List>
std::string joined(const List& entries) {
    std::string out;
    for (const auto& entry : entries) out += str(out.empty() ? "" : ", ", entry);
    return out;
}

/// Lower case of ASCII text.
inline std::string lower_case(std::string_view text) {
    std::string out(text);
    for (char& c : out) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return out;
}

/// Excerpt of a file for a message: the first 40 characters, with '?' for non-printable ones.
inline std::string shown(std::string_view text) {
    std::string out(text.substr(0, 40));
    for (char& c : out)
        if (static_cast<unsigned char>(c) < 32 || static_cast<unsigned char>(c) > 126) c = '?';
    return out;
}

/// Removes the next line from the front of `text` and returns it without its end.
inline std::string_view next_line(std::string_view& text) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    return line;
}

/// Removes the next word from the front of `text` and returns it; empty when there is none.
inline std::string_view next_word(std::string_view& text) {
    text.remove_prefix(std::min(text.find_first_not_of(" \t\r\n"), text.size()));
    const std::string_view word = text.substr(0, text.find_first_of(" \t\r\n"));
    text.remove_prefix(word.size());
    return word;
}

}  // namespace tvsgs
