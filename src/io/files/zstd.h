// Compression of zstd frames.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace tvsgs {

/// One frame with a checksum. The bytes do not depend on the number of threads.
std::vector<std::uint8_t> zstd_frame(std::span<const std::uint8_t> bytes);

/// Unpacks the frame into all of `out`. Throws Error(ExitCode::input) if the frame is damaged or
/// has another size. Messages contain `where`.
void read_zstd_frame(std::span<const std::uint8_t> frame,
                     std::span<std::uint8_t> out,
                     const std::string& where);

}  // namespace tvsgs
