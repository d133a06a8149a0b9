// Checkpoint files: named arrays, versioned and checksummed.
//
//   "TVSGSCKP", version, bytes of the table, bytes of the file, arrays (little endian, 4 4 8 4)
//   table: per array the length of its name, name, bytes per element, whether of floats, bytes, CRC
//   CRC of all above, then the arrays in order
#pragma once

#include <initializer_list>
#include <string>
#include <vector>

#include "core/scene/state.h"
#include "io/files/atomic_file.h"

namespace tvsgs {

inline constexpr std::uint32_t kCheckpointVersion = 1;

/// CRC-32; `so_far` is that of the bytes before.
std::uint32_t checksum(const void* data, std::size_t bytes, std::uint32_t so_far = 0);

/// That of two texts, one after the other, from theirs.
std::uint32_t checksum_of_both(std::uint32_t first, std::uint32_t second, std::size_t second_bytes);

/// What the table says of an array.
struct CheckpointEntry {
    std::string name;
    std::uint32_t element_bytes;
    bool real;
    std::uint64_t bytes;
    std::uint32_t crc;
};
CheckpointEntry entry_of(const StateArray& array);

/// A checkpoint that is written piece by piece: the arrays of the entries, one after the other.
/// Throws Error(ExitCode::io).
class CheckpointFile {
public:
    CheckpointFile(const std::string& path, const std::vector<CheckpointEntry>& entries);
    void write(const void* data, std::size_t bytes) { file_.write(data, bytes); }
    /// The file appears complete or not at all, and has reached the disk.
    void commit() { file_.commit(); }

private:
    AtomicFile file_;
};

/// Writes the arrays of all parts. The file appears complete or not at all, and has reached the
/// disk. Throws Error(ExitCode::io).
void write_checkpoint(const std::string& path, std::initializer_list<const State*> parts);

/// Throws Error(ExitCode::input) naming what is wrong when the file is no checkpoint, of another
/// version, cut off or damaged anywhere.
State read_checkpoint(const std::string& path);

}  // namespace tvsgs
