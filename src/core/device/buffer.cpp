#include "core/device/buffer.h"

#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <string>

#include "core/device/memory_ledger.h"
#include "core/error.h"
#include "core/grouped.h"

namespace tvsgs {
namespace {
constexpr std::size_t kAlignment = 256;  // a multiple of cache lines and of vector registers
}  // namespace

MemoryLedger& host_ledger() {
    static MemoryLedger ledger;
    return ledger;
}

void throw_out_of_host_memory(std::size_t bytes, bool allowed) {
    const MemoryLedger& ledger = host_ledger();
    throw out_of_memory(
        str("host memory: ", grouped(bytes), " more bytes needed, ", grouped(ledger.current >> 20),
            " MiB in use, ",
            allowed ? std::string("none left on this machine")
                    : str("limit ", grouped(ledger.limit >> 20), " MiB (memory.host)")));
}

MemoryUse memory_use(Cpu) {
    return host_ledger().use();
}

void set_memory_limit(Cpu, std::int64_t bytes) {
    host_ledger().limit = bytes;
}

namespace detail {

void* allocate(Cpu, std::size_t bytes) {
    if (bytes == 0) return nullptr;
    const std::size_t rounded = (bytes + kAlignment - 1) / kAlignment * kAlignment;
    const bool allowed = host_ledger().allows(bytes);
    void* data = allowed ? std::aligned_alloc(kAlignment, rounded) : nullptr;
    if (data == nullptr) throw_out_of_host_memory(bytes, allowed);
    host_ledger().take(bytes);
    return data;
}

void release(Cpu, void* data, std::size_t bytes) {
    std::free(data);
    host_ledger().give_back(bytes);
}

void fill_zero(Cpu, void* data, std::size_t bytes) {
    if (bytes > 0) std::memset(data, 0, bytes);
}

void copy(Cpu, const void* from, Cpu, void* to, std::size_t bytes) {
    if (bytes > 0) std::memcpy(to, from, bytes);
}

}  // namespace detail

std::int64_t free_host_bytes() {
    // MemAvailable includes memory that the page cache would free; the C library's figure does not.
    std::ifstream file("/proc/meminfo");
    for (std::string name; file >> name;) {
        std::int64_t kib = 0;
        if (name == "MemAvailable:" && file >> kib) return kib * 1024;
        file.ignore(256, '\n');
    }
    return static_cast<std::int64_t>(sysconf(_SC_AVPHYS_PAGES)) * sysconf(_SC_PAGESIZE);
}

}  // namespace tvsgs
