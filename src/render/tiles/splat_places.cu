#include <thrust/iterator/counting_iterator.h>
#include <thrust/iterator/transform_iterator.h>

#include <cub/cub.cuh>

#include "render/tiles/splat_places.h"

namespace tvsgs {
namespace {

struct InView {
    Span<const float> radii;
    TVSGS_HD std::uint32_t operator()(std::uint32_t i) const {
        return i < radii.count && radii[i] > 0;
    }
};

}  // namespace

void count_in_view(const Buffer<float, Cuda>& radii,
                   Buffer<std::uint32_t, Cuda>& before,
                   Buffer<std::uint8_t, Cuda>& temporary) {
    const std::size_t count = radii.size() + 1;
    before.resize(count);
    const auto in_view = thrust::make_transform_iterator(
        thrust::make_counting_iterator<std::uint32_t>(0), InView{radii.span()});
    const auto scan = [&](void* memory, std::size_t& bytes) {
        check_cuda(cub::DeviceScan::ExclusiveSum(memory, bytes, in_view, before.data(),
                                                 static_cast<int>(count)));
    };
    std::size_t bytes = 0;
    scan(nullptr, bytes);
    if (temporary.size() < bytes) temporary.resize(bytes);
    scan(temporary.data(), bytes);
}

}  // namespace tvsgs
