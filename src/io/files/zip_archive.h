// ZIP archives, through libzip.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace tvsgs {

/// What a reader takes; more is refused before there is memory for it.
struct ZipLimits {
    std::uint64_t entries = 65536, entry_bytes = std::uint64_t{1} << 30;
    std::uint64_t total_bytes = std::uint64_t{1} << 33;  // of all entries
    std::uint64_t ratio = 1100;  // of an entry to what is stored of it; deflate's is 1032 at most
};

/// take(name, bytes) for each entry in its order, stored or deflated; `kind` is what the archive
/// should be, for messages. Checksums are compared, and no name appears twice. Throws
/// Error(ExitCode::input).
void read_zip(const std::string& path,
              const std::string& kind,
              const ZipLimits& limits,
              const std::function<void(const std::string& name, std::string bytes)>& take);

/// The bytes of an archive that stores its entries as they are, in their order: the same for the
/// same entries.
std::string zip_bytes(const std::vector<std::pair<std::string, std::string>>& entries);

}  // namespace tvsgs
