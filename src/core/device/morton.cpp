#include "core/device/morton.h"

#include <functional>
#include <vector>

#include "core/device/parallel_lists.h"

namespace tvsgs {

void morton_order(Span<const Vec3f> points, Buffer<int, Cpu>& order) {
    detail::PointBox box;
    for (const Vec3f p : points) box = detail::UniteBoxes{}(box, detail::BoxOfPoint{}(p));
    struct Key {
        std::uint64_t high, low;
        int place;
        auto operator<=>(const Key&) const = default;
    };
    std::vector<Key> keys(points.count);
    parallel_for(Cpu{}, points.size(), [&](std::size_t at) {
        const MortonCode code = box.code(points[at]);
        keys[at] = {code.high, code.low, static_cast<int>(at)};
    });
    sort_in_parallel(keys, std::less<>());
    order.resize(points.count);
    parallel_for(Cpu{}, points.size(), [&](int i) { order[i] = keys[i].place; });
}

}  // namespace tvsgs
