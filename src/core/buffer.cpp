#include "core/buffer.h"

#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <string>

#include "core/error.h"

namespace tvsgs {
namespace {
std::atomic<std::int64_t> current_bytes{0}, peak_bytes{0}, limit_bytes{INT64_MAX};
constexpr std::size_t kAlignment = 256;  // a whole number of cache lines and of vector registers
}  // namespace

MemoryUse memory_use(Cpu) {
    return {current_bytes, peak_bytes};
}

void set_memory_limit(Cpu, std::int64_t bytes) {
    limit_bytes = bytes;
}

namespace detail {

void* allocate(Cpu, std::size_t bytes) {
    if (bytes == 0) return nullptr;
    const std::size_t rounded = (bytes + kAlignment - 1) / kAlignment * kAlignment;
    const std::int64_t held = current_bytes, limit = limit_bytes;
    const bool allowed = static_cast<std::int64_t>(bytes) <= limit - held;
    void* data = allowed ? std::aligned_alloc(kAlignment, rounded) : nullptr;
    if (data == nullptr)
        throw out_of_memory(
            str(bytes, " more bytes are needed beside the ", held >> 20, " MiB held, ",
                allowed ? std::string("and the host has no more")
                        : str("and ", limit >> 20, " MiB are allowed (memory.host)")));
    const std::int64_t now = current_bytes += static_cast<std::int64_t>(bytes);
    for (std::int64_t peak = peak_bytes;
         now > peak && !peak_bytes.compare_exchange_weak(peak, now);) {
    }
    return data;
}

void release(Cpu, void* data, std::size_t bytes) {
    std::free(data);
    current_bytes -= static_cast<std::int64_t>(bytes);
}

void fill_zero(Cpu, void* data, std::size_t bytes) {
    if (bytes > 0) std::memset(data, 0, bytes);
}

void copy(Cpu, const void* from, Cpu, void* to, std::size_t bytes) {
    if (bytes > 0) std::memcpy(to, from, bytes);
}

}  // namespace detail

std::int64_t free_host_bytes() {
    // MemAvailable counts what the page cache would give back; the C library's figure does not.
    std::ifstream file("/proc/meminfo");
    for (std::string name; file >> name;) {
        std::int64_t kib = 0;
        if (name == "MemAvailable:" && file >> kib) return kib * 1024;
        file.ignore(256, '\n');
    }
    return static_cast<std::int64_t>(sysconf(_SC_AVPHYS_PAGES)) * sysconf(_SC_PAGESIZE);
}

}  // namespace tvsgs
