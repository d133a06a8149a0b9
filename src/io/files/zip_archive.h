// Reading and writing of ZIP archives by libzip.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace tvsgs {

/// Limits of an archive. The reader refuses larger ones before it allocates memory.
struct ZipLimits {
    std::uint64_t entries = 65536, entry_bytes = std::uint64_t{1} << 30;
    std::uint64_t total_bytes = std::uint64_t{1} << 33;  // of all entries together
    std::uint64_t ratio = 1100;  // unpacked / packed bytes of an entry; deflate: up to 1032
};

/// Calls take(name, bytes) for each entry in order; entries are stored or deflated. Messages name
/// the expected `kind` of archive. Checks checksums and rejects duplicate names. Throws
/// Error(ExitCode::input).
void read_zip(const std::string& path,
              const std::string& kind,
              const ZipLimits& limits,
              const std::function<void(const std::string& name, std::string bytes)>& take);

/// Bytes of an archive that stores the entries without compression, in order. Equal entries give
/// equal bytes.
std::string zip_bytes(const std::vector<std::pair<std::string, std::string>>& entries);

}  // namespace tvsgs
