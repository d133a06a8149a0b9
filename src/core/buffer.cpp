#include "core/buffer.h"

#include <atomic>
#include <cstdlib>
#include <cstring>

#include "core/error.h"

namespace tvsgs {
namespace {
std::atomic<std::int64_t> current_bytes{0}, peak_bytes{0};
constexpr std::size_t kAlignment = 256;  // a whole number of cache lines and of vector registers
}  // namespace

MemoryUse memory_use(Cpu) {
    return {current_bytes, peak_bytes};
}

namespace detail {

void* allocate(Cpu, std::size_t bytes) {
    if (bytes == 0) return nullptr;
    const std::size_t rounded = (bytes + kAlignment - 1) / kAlignment * kAlignment;
    void* data = std::aligned_alloc(kAlignment, rounded);
    if (data == nullptr)
        throw Error(ExitCode::memory,
                    str("out of memory: could not get ", bytes >> 20, " MiB beside the ",
                        current_bytes.load() >> 20,
                        " MiB held; use fewer splats (--max-gaussians) or smaller images (-r)"));
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
}  // namespace tvsgs
