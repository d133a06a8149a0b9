// Frames of zstd.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace tvsgs {

/// One frame with its checksum; the same bytes for any number of threads.
std::vector<std::uint8_t> zstd_frame(std::span<const std::uint8_t> bytes);

/// Fills all of `out`. Throws Error(ExitCode::input) where the frame is damaged or holds another
/// number of bytes; `where`: what the message calls it.
void read_zstd_frame(std::span<const std::uint8_t> frame,
                     std::span<std::uint8_t> out,
                     const std::string& where);

}  // namespace tvsgs
