// The readers under fuzzing: each takes a file of any bytes and answers with what it has read or
// with an Error that a user can act on.
#pragma once

#include <cstdint>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

namespace tvsgs::fuzz {

struct Target {
    const char* name;  // also the folder of its seeds, see make_corpus.py
    const char* file;  // what the bytes are saved as, in a folder of their own
    void (*read)(const std::string& folder, const std::string& file);
    /// Makes a checksum fit, so that what lies behind it is reached; may be null.
    std::string (*mend)(std::string bytes);
};

/// As tests show it.
inline void PrintTo(const Target& target, std::ostream* out) {
    *out << target.name;
}

const std::vector<Target>& targets();

/// Throws Error(ExitCode::internal) naming the known ones.
const Target& find_target(std::string_view name);

/// Writes the bytes, reads them, and throws std::logic_error when the answer is none: an exception
/// that is no Error, one of another kind than input or usage, or an empty message or one with bytes
/// that would reach a terminal.
void run(const Target& target, std::string_view bytes);

}  // namespace tvsgs::fuzz
