// Checkpoint files: named arrays with a version and checksums.
//
//   "TVSGSCKP", version, bytes of the table, bytes of the file, arrays (little endian, 4 4 8 4)
//   table: per array length of its name, name, bytes per element, whether floats, bytes, CRC
//   CRC of all above, then the arrays in order
#pragma once

#include <initializer_list>
#include <string>
#include <vector>

#include "core/scene/state.h"
#include "io/files/atomic_file.h"

namespace tvsgs {

inline constexpr std::uint32_t kCheckpointVersion = 1;

/// CRC-32 of the bytes. `so_far`: CRC-32 of the preceding bytes.
std::uint32_t checksum(const void* data, std::size_t bytes, std::uint32_t so_far = 0);

/// CRC-32 of two concatenated texts from the CRC-32 of each.
std::uint32_t checksum_of_both(std::uint32_t first, std::uint32_t second, std::size_t second_bytes);

/// Entry of an array in the table of the file.
struct CheckpointEntry {
    std::string name;
    std::uint32_t element_bytes;
    bool real;
    std::uint64_t bytes;
    std::uint32_t crc;
};
/// The entry that describes an array.
CheckpointEntry entry_of(const StateArray& array);

/// Writes a checkpoint in pieces: first the table of entries, then the arrays one after the other.
/// Throws Error(ExitCode::io).
class CheckpointFile {
public:
    CheckpointFile(const std::string& path, const std::vector<CheckpointEntry>& entries);
    void write(const void* data, std::size_t bytes) { file_.write(data, bytes); }
    /// Makes the file appear, complete and flushed to disk.
    void commit() { file_.commit(); }

private:
    AtomicFile file_;
};

/// Writes the arrays of all parts. The file appears complete and flushed to disk, or not at all.
/// Throws Error(ExitCode::io).
void write_checkpoint(const std::string& path, std::initializer_list<const State*> parts);

/// Throws Error(ExitCode::input) that names the reason if the file is not a checkpoint, has another
/// version, is cut off or is damaged.
State read_checkpoint(const std::string& path);

}  // namespace tvsgs
