#include "eval/frame_check.h"

#include <algorithm>

#include "core/error.h"

namespace tvsgs {
namespace {

std::string point_text(Vec3d p) {
    return str("(", p.x, ", ", p.y, ", ", p.z, ")");
}

}  // namespace

FrameCheck check_frame(const std::vector<Vec3d>& prediction, const std::vector<Vec3d>& truth) {
    FrameCheck check;
    int side = 0;
    for (const std::vector<Vec3d>* points : {&prediction, &truth}) {
        const std::size_t stride = points->size() / 100000 + 1;  // enough for a percentile
        for (int axis = 0; axis < 3; ++axis) {
            std::vector<double> values;
            for (std::size_t i = 0; i < points->size(); i += stride)
                values.push_back((*points)[i][axis]);
            const auto percentile = [&](double share) {
                const auto at =
                    values.begin() +
                    static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
                std::nth_element(values.begin(), at, values.end());
                return *at;
            };
            check.lower[side][axis] = percentile(0.05);
            check.upper[side][axis] = percentile(0.95);
        }
        ++side;
    }
    double size[2] = {0, 0};
    Vec3d centre[2];
    for (int s = 0; s < 2; ++s) {
        size[s] = norm(check.upper[s] - check.lower[s]);
        centre[s] = 0.5 * (check.upper[s] + check.lower[s]);
    }
    check.offset = centre[0] - centre[1];
    // A single point has no size to compare.
    if (size[0] > 0 && size[1] > 0) check.size_ratio = size[0] / size[1];
    for (int axis = 0; axis < 3; ++axis) {
        // Surfaces can be flat along an axis: allow a tenth of the truth's size.
        const double slack = 0.1 * size[1];
        check.apart |= check.lower[0][axis] > check.upper[1][axis] + slack ||
                       check.lower[1][axis] > check.upper[0][axis] + slack;
    }
    return check;
}

std::string FrameCheck::text() const {
    return str("the prediction spans ", point_text(lower[0]), " to ", point_text(upper[0]),
               ", the truth ", point_text(lower[1]), " to ", point_text(upper[1]),
               "; its centre is off by ", point_text(offset), ", ", norm(offset),
               " in all, and it is ", size_ratio, " times as large");
}

}  // namespace tvsgs
