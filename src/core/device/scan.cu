#include <cub/cub.cuh>

#include "core/device/cuda_runtime.h"
#include "core/device/scan.h"

namespace tvsgs {

void exclusive_scan(const Buffer<int, Cuda>& in,
                    Buffer<int, Cuda>& out,
                    Buffer<std::uint8_t, Cuda>& scratch) {
    const std::size_t n = in.size();
    out.resize(n);
    if (n == 0) return;
    std::size_t bytes = 0;
    check_cuda(
        cub::DeviceScan::ExclusiveSum(nullptr, bytes, in.data(), out.data(), static_cast<int>(n)));
    scratch.resize(bytes);
    check_cuda(cub::DeviceScan::ExclusiveSum(scratch.data(), bytes, in.data(), out.data(),
                                             static_cast<int>(n)));
}

int exclusive_scan(const Buffer<int, Cuda>& in, Buffer<int, Cuda>& out) {
    const std::size_t n = in.size();
    Buffer<std::uint8_t, Cuda> temporary;  // allocates: only for rare calls
    exclusive_scan(in, out, temporary);
    if (n == 0) return 0;
    int last[2];
    detail::copy(Cuda{}, out.data() + n - 1, Cpu{}, &last[0], sizeof(int));
    detail::copy(Cuda{}, in.data() + n - 1, Cpu{}, &last[1], sizeof(int));
    return last[0] + last[1];
}

}  // namespace tvsgs
