// Checkpoint files: named arrays with a version and checksums.
//
//   "TVSGSCKP", version, bytes of the table, bytes of the file, arrays (little endian, 4 4 8 4)
//   table: per array length of its name, name, bytes per element, whether floats, bytes, CRC
//   CRC of all above, then the arrays in order
#pragma once

#include <initializer_list>
#include <string>

#include "core/scene/state.h"

namespace tvsgs {

inline constexpr std::uint32_t kCheckpointVersion = 1;

/// CRC-32 of the bytes. `so_far`: CRC-32 of the preceding bytes.
std::uint32_t checksum(const void* data, std::size_t bytes, std::uint32_t so_far = 0);

/// Writes the arrays of all parts. The file appears complete and flushed to disk, or not at all.
/// Throws Error(ExitCode::io).
void write_checkpoint(const std::string& path, std::initializer_list<const State*> parts);

/// Throws Error(ExitCode::input) that names the reason if the file is not a checkpoint, has another
/// version, is cut off or is damaged.
State read_checkpoint(const std::string& path);

}  // namespace tvsgs
