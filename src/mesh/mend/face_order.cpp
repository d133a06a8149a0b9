#include "mesh/mend/face_order.h"

#include "core/device/morton.h"
#include "core/device/parallel_lists.h"
#include "core/scene/view_frustum.h"

namespace tvsgs {

SpatialOrder spatial_order(const std::vector<Vec3f>& points) {
    constexpr float kCells = 1 << 10;  // along an axis
    Box3f box;
    for (const Vec3f& p : points) box.add(p);
    const Vec3f size = box.high - box.low;
    const float extent = std::max({0.0f, size.x, size.y, size.z});
    const float scale = extent > 0 ? kCells / extent : 0;
    std::vector<std::pair<std::uint32_t, int>> keyed(points.size());
    parallel_for(Cpu{}, static_cast<int>(points.size()), [&](int i) {
        std::uint32_t key = 0;
        for (int axis = 0; axis < 3; ++axis) {
            const float cell = scale * (points[i][axis] - box.low[axis]);
            const auto bits = static_cast<std::uint64_t>(cell < kCells - 1 ? cell : kCells - 1);
            key |= static_cast<std::uint32_t>(spread_bits(bits)) << axis;
        }
        keyed[i] = {key, i};
    });
    sort_in_parallel(keyed, std::less<>());
    SpatialOrder order;
    for (const auto& [key, place] : keyed)
        order.places.push_back(place), order.codes.push_back(key);
    return order;
}

}  // namespace tvsgs
