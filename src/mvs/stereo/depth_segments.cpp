#include "mvs/stereo/depth_segments.h"

#include <algorithm>
#include <cmath>

#include "core/device/parallel.h"

namespace tvsgs {
namespace {

constexpr float kSameSurface = 0.01f;     // relative jump of depth
constexpr std::size_t kMinSegment = 100;  // px; wrong depths agree by chance in small segments

void clear_small_segments(const DepthMapSpan& map) {
    const int count = map.width * map.height;
    std::vector<char> visited(static_cast<std::size_t>(count), 0);
    std::vector<int> segment;
    for (int start = 0; start < count; ++start) {
        if (visited[start] != 0 || !(map.depth[start] > 0)) continue;
        segment.assign(1, start);
        visited[start] = 1;
        for (std::size_t next = 0; next < segment.size(); ++next) {
            const int at = segment[next], x = at % map.width, y = at / map.width;
            for (int py = std::max(y - 1, 0); py <= std::min(y + 1, map.height - 1); ++py)
                for (int px = std::max(x - 1, 0); px <= std::min(x + 1, map.width - 1); ++px) {
                    const int other = py * map.width + px;
                    if (visited[other] != 0) continue;
                    if (!(map.depth[other] > 0) || !(std::abs(map.depth[other] - map.depth[at]) <
                                                     kSameSurface * map.depth[at]))
                        continue;
                    visited[other] = 1;
                    segment.push_back(other);
                }
        }
        if (segment.size() < kMinSegment)
            for (const int at : segment) map.depth[at] = map.confidence[at] = 0;
    }
}

}  // namespace

void remove_small_segments(const std::vector<DepthMapSpan>& maps) {
    parallel_for_heavy(Cpu{}, static_cast<int>(maps.size()),
                       [&](int i) { clear_small_segments(maps[i]); });
}

}  // namespace tvsgs
