// Numbers as flags and keys have them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs {

/// Positive numbers with commas between. Throws Error(ExitCode::usage) naming the flag.
std::vector<double> parse_numbers(const std::string& flag, const std::string& text);

/// A number of bytes with an optional suffix K, M, G or T, powers of 1024. Throws
/// Error(ExitCode::usage) naming the flag or key.
std::int64_t parse_bytes(const std::string& flag, const std::string& text);

struct Box3d {
    Vec3d low, high;
};

/// "x0,y0,z0,x1,y1,z1", each low end below its high end. Throws Error(ExitCode::usage) naming the
/// flag.
Box3d parse_box(const std::string& flag, const std::string& text);

}  // namespace tvsgs
