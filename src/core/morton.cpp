#include "core/morton.h"

#include <algorithm>
#include <vector>

namespace tvsgs {

void morton_order(Span<const Vec3f> points, Buffer<int, Cpu>& order) {
    detail::PointBox box;
    for (const Vec3f p : points) box = detail::UniteBoxes{}(box, detail::BoxOfPoint{}(p));
    struct Key {
        std::uint64_t high, low;
        int place;
        auto operator<=>(const Key&) const = default;
    };
    std::vector<Key> keys;
    keys.reserve(points.count);
    for (const Vec3f p : points) {
        const MortonCode code = box.code(p);
        keys.push_back({code.high, code.low, static_cast<int>(keys.size())});
    }
    std::sort(keys.begin(), keys.end());
    order.resize(points.count);
    for (std::size_t i = 0; i < keys.size(); ++i) order[i] = keys[i].place;
}

}  // namespace tvsgs
