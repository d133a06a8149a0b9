// The readers under fuzzing: each reads a file of any bytes and returns a result or throws Error.
#pragma once

#include <cstdint>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

namespace tvsgs::fuzz {

struct Target {
    const char* name;  // also the folder of its seeds, see make_corpus.py
    const char* file;  // name of the saved file, alone in a folder
    void (*read)(const std::string& folder, const std::string& file);
    /// Corrects checksums, so that the reader goes on to the content; may be null.
    std::string (*mend)(std::string bytes);
};

/// For messages of gtest.
inline void PrintTo(const Target& target, std::ostream* out) {
    *out << target.name;
}

const std::vector<Target>& targets();

/// Throws Error(ExitCode::internal) for an unknown name.
const Target& find_target(std::string_view name);

/// Writes the bytes and reads them. Throws std::logic_error for an exception other than an Error of
/// kind input or usage, and for a message that is short or has control characters.
void run(const Target& target, std::string_view bytes);

}  // namespace tvsgs::fuzz
