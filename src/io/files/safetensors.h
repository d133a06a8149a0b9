// Reading of safetensors files, and of network weights as .npz or .safetensors.
#pragma once

#include "io/files/npz.h"

namespace tvsgs {

/// All tensors of type F16, F32 or F64 by name. Checks the header, ranges and overlaps. Throws
/// Error(ExitCode::input).
NpzArchive read_safetensors(const std::string& path);

/// Reads a .npz or .safetensors file; the first bytes tell the format.
NpzArchive read_tensors(const std::string& path);

}  // namespace tvsgs
