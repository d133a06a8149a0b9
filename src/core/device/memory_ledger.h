// Account of the bytes that all buffers of one kind of memory hold.
#pragma once

#include <atomic>

#include "core/device/buffer.h"

namespace tvsgs {

/// Bytes in use, their maximum and their limit. Several threads may use it.
struct MemoryLedger {
    std::atomic<std::int64_t> current{0}, peak{0}, limit{INT64_MAX};  // bytes

    bool allows(std::size_t bytes) const {
        return static_cast<std::int64_t>(bytes) <= limit - current;
    }
    void take(std::size_t bytes) {
        const std::int64_t now = current += static_cast<std::int64_t>(bytes);
        for (std::int64_t most = peak; now > most && !peak.compare_exchange_weak(most, now);) {
        }
    }
    void give_back(std::size_t bytes) { current -= static_cast<std::int64_t>(bytes); }
    MemoryUse use() const { return {current, peak}; }
};

/// Account of host memory, also for a GPU's buffers that were placed on the host.
MemoryLedger& host_ledger();

/// Throws Error(ExitCode::memory) for a request of `bytes`. `allowed`: the limit permits the
/// request, but the allocation failed; otherwise the limit forbids it.
[[noreturn]] void throw_out_of_host_memory(std::size_t bytes, bool allowed);

}  // namespace tvsgs
