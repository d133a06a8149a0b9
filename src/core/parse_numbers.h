// Numbers as flags and keys have them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace tvsgs {

/// Positive numbers with commas between. Throws Error(ExitCode::usage) naming the flag.
std::vector<double> parse_numbers(const std::string& flag, const std::string& text);

/// A number of bytes with an optional suffix K, M, G or T, powers of 1024. Throws
/// Error(ExitCode::usage) naming the flag or key.
std::int64_t parse_bytes(const std::string& flag, const std::string& text);

}  // namespace tvsgs
