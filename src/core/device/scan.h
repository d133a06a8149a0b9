// Exclusive prefix sums.
#pragma once

#include "core/device/buffer.h"

namespace tvsgs {

/// Exclusive prefix sum: out[i] = in[0] + ... + in[i-1]. Resizes `out`, waits for the device and
/// returns the total.
inline int exclusive_scan(const Buffer<int, Cpu>& in, Buffer<int, Cpu>& out) {
    out.resize(in.size());
    int total = 0;
    for (std::size_t i = 0; i < in.size(); ++i) out[i] = total, total += in[i];
    return total;
}
int exclusive_scan(const Buffer<int, Cuda>& in, Buffer<int, Cuda>& out);

/// The same without the total and without waiting. `scratch` is resized as needed.
inline void exclusive_scan(const Buffer<int, Cpu>& in,
                           Buffer<int, Cpu>& out,
                           Buffer<std::uint8_t, Cpu>& /*scratch*/) {
    exclusive_scan(in, out);
}
void exclusive_scan(const Buffer<int, Cuda>& in,
                    Buffer<int, Cuda>& out,
                    Buffer<std::uint8_t, Cuda>& scratch);

}  // namespace tvsgs
