// Files of the safetensors format, and weights of a network in either of the two formats we read.
#pragma once

#include "io/files/npz.h"

namespace tvsgs {

/// All tensors of F16, F32 or F64 by name; header, ranges and overlaps are checked. Throws
/// Error(ExitCode::input).
NpzArchive read_safetensors(const std::string& path);

/// A .npz or .safetensors file, told apart by their first bytes.
NpzArchive read_tensors(const std::string& path);

}  // namespace tvsgs
