#include "mesh/device_algorithms.h"

#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <string>

namespace tvsgs {

void sort_unique(Buffer<std::uint64_t, Cpu>& keys) {
    std::uint64_t* const begin = keys.data();
    std::uint64_t* const end = begin + keys.size();
    std::sort(begin, end);
    keys.resize(static_cast<std::size_t>(std::unique(begin, end) - begin));
}

std::uint64_t exclusive_scan(Buffer<std::uint32_t, Cpu>& counts) {
    std::uint64_t total = 0;
    for (std::uint32_t& count : counts.span()) {
        const std::uint32_t before = static_cast<std::uint32_t>(total);
        total += count;
        count = before;
    }
    return total;
}

std::int64_t free_bytes(Cpu) {
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
