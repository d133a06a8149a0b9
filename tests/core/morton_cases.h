// Point clouds that often break Morton orders.
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "core/math/rng.h"
#include "core/math/vec.h"

namespace tvsgs::test {

inline const std::vector<std::string>& morton_clouds() {
    static const std::vector<std::string> names = {
        "ball",       "far from zero",  "coincident", "far clusters", "outlier", "extreme outlier",
        "not finite", "nothing finite", "line"};
    return names;
}

inline std::vector<Vec3f> morton_cloud(const std::string& kind, int count) {
    std::vector<Vec3f> points;
    for (int i = 0; i < count; ++i) {
        Vec3f p = normal3(random4(3, RandomStream::test, static_cast<std::uint64_t>(i)));
        if (kind == "far from zero") p = 100.0f * p + Vec3f{1e7f, -1e7f, 5e6f};  // many ties
        if (kind == "coincident") p = {1, 2, 3};
        if (kind == "far clusters" && i % 2 == 0) p += Vec3f{1e6f, 0, 0};
        if (kind == "outlier" && i == 1) p = {1e6f, -1e6f, 0};
        if (kind == "extreme outlier" && i == 1) p = {3e38f, -3e38f, 0};
        if (kind == "not finite" && i % 7 == 0) p.y = i % 2 == 0 ? std::nanf("") : HUGE_VALF;
        if (kind == "nothing finite") p.z = -HUGE_VALF;
        if (kind == "line") p = {0, p.y, 0};
        points.push_back(p);
    }
    return points;
}

}  // namespace tvsgs::test
