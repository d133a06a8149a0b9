// What the buffers of one kind of memory hold together.
#pragma once

#include <atomic>

#include "core/device/buffer.h"

namespace tvsgs {

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

/// Of the host, where buffers of a GPU may lie as well.
MemoryLedger& host_ledger();

/// That the host has no room for so many bytes more: its own limit, or, `allowed`, its memory.
[[noreturn]] void throw_out_of_host_memory(std::size_t bytes, bool allowed);

}  // namespace tvsgs
