#include "mesh/fuse/device_algorithms.h"

#include <algorithm>

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

std::int64_t host_budget(std::int64_t max_bytes) {
    constexpr double kShareOfFreeMemory = 0.8;
    return std::min(max_bytes,
                    static_cast<std::int64_t>(kShareOfFreeMemory * double(free_host_bytes())));
}

}  // namespace tvsgs
