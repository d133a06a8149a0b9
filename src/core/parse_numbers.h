// Parsing of numbers in flags and configuration keys.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs {

/// Parses positive numbers separated by commas. Throws Error(ExitCode::usage) naming the flag.
std::vector<double> parse_numbers(const std::string& flag, const std::string& text);

/// Parses a number of bytes with an optional suffix K, M, G or T (powers of 1024). Throws
/// Error(ExitCode::usage) naming the flag or key.
std::int64_t parse_bytes(const std::string& flag, const std::string& text);

struct Box3d {
    Vec3d low, high;
};

/// Parses "x0,y0,z0,x1,y1,z1"; each lower bound must be below its upper bound. Throws
/// Error(ExitCode::usage) naming the flag.
Box3d parse_box(const std::string& flag, const std::string& text);

}  // namespace tvsgs
