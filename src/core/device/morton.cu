#include <thrust/iterator/transform_iterator.h>

#include <cub/cub.cuh>

#include "core/device/morton.h"
#include "core/device/parallel.h"

namespace tvsgs {
namespace {

struct IotaBody {
    Span<int> values;
    TVSGS_HD void operator()(int i) const { values[i] = i; }
};

struct CodeBody {
    Span<const Vec3f> points;
    const detail::PointBox* box;
    bool high_word;
    const int* order;
    std::uint64_t* codes;
    TVSGS_HD void operator()(int i) const {
        const MortonCode code = box->code(points[order[i]]);
        codes[i] = high_word ? code.high : code.low;
    }
};

/// If `memory` is null, run(memory, bytes) returns the size that it needs in `bytes`.
template <class Run>
void with_temporary(Buffer<std::uint8_t, Cuda>& temporary, const Run& run) {
    std::size_t bytes = 0;
    check_cuda(run(nullptr, bytes));
    temporary.resize(bytes);
    check_cuda(run(temporary.data(), bytes));
}

}  // namespace

void morton_order(Span<const Vec3f> points, Buffer<int, Cuda>& order) {
    const std::size_t n = points.count;
    const int count = points.size();
    order.resize(n);
    if (n == 0) return;
    Buffer<std::uint8_t, Cuda> temporary;
    Buffer<detail::PointBox, Cuda> box(1);
    with_temporary(temporary, [&](void* memory, std::size_t& bytes) {
        return cub::DeviceReduce::Reduce(
            memory, bytes, thrust::make_transform_iterator(points.data, detail::BoxOfPoint{}),
            box.data(), count, detail::UniteBoxes{}, detail::PointBox{});
    });
    Buffer<std::uint64_t, Cuda> codes(2 * n);
    Buffer<int, Cuda> spare(n);
    cub::DoubleBuffer<std::uint64_t> keys(codes.data(), codes.data() + n);
    cub::DoubleBuffer<int> places(order.data(), spare.data());
    parallel_for(Cuda{}, count, IotaBody{order.span()});
    for (const bool high_word : {false, true}) {  // low word first: the sort is stable
        parallel_for(Cuda{}, count,
                     CodeBody{points, box.data(), high_word, places.Current(), keys.Current()});
        with_temporary(temporary, [&](void* memory, std::size_t& bytes) {
            return cub::DeviceRadixSort::SortPairs(memory, bytes, keys, places, count, 0, 63);
        });
    }
    if (places.Current() != order.data()) order.swap(spare);
}

}  // namespace tvsgs
