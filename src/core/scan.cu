#include <cub/cub.cuh>

#include "core/cuda_runtime.h"
#include "core/scan.h"

namespace tvsgs {

int exclusive_scan(const Buffer<int, Cuda>& in, Buffer<int, Cuda>& out) {
    const std::size_t n = in.size();
    out.resize(n);
    if (n == 0) return 0;
    std::size_t bytes = 0;
    check_cuda(
        cub::DeviceScan::ExclusiveSum(nullptr, bytes, in.data(), out.data(), static_cast<int>(n)));
    Buffer<std::uint8_t, Cuda> temporary(bytes);  // rare: structure changes only
    check_cuda(cub::DeviceScan::ExclusiveSum(temporary.data(), bytes, in.data(), out.data(),
                                             static_cast<int>(n)));
    int last[2];
    detail::copy(Cuda{}, out.data() + n - 1, Cpu{}, &last[0], sizeof(int));
    detail::copy(Cuda{}, in.data() + n - 1, Cpu{}, &last[1], sizeof(int));
    return last[0] + last[1];
}

}  // namespace tvsgs
