#include <algorithm>
#include <cmath>
#include <utility>

#include "core/device/parallel.h"
#include "mesh/closed/poisson.h"
#include "mesh/fuse/device_algorithms.h"

namespace tvsgs {

PoissonLevel::PoissonLevel(float spacing_of_nodes, std::vector<std::uint64_t> block_keys)
    : spacing(spacing_of_nodes), keys(std::move(block_keys)), neighbours(keys.size() * 27) {
    parallel_for(Cpu{}, size(), [&](int b) {
        const Vec3i block = block_of_key(keys[b]);
        for (int i = 0; i < 27; ++i)
            neighbours[static_cast<std::size_t>(b) * 27 + static_cast<std::size_t>(i)] =
                find(block + Vec3i{i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1});
    });
}

int PoissonLevel::find(Vec3i block) const {
    return find_key({keys.data(), keys.size()}, block_key(block));
}

Vec3i node_below(Vec3f p, float spacing) {
    const auto below = [&](float x) {
        return static_cast<int>(
            std::floor(static_cast<double>(x) / static_cast<double>(spacing) - 0.5));
    };
    return {below(p.x), below(p.y), below(p.z)};
}

void sort_unique(std::vector<std::uint64_t>& keys) {
    std::ranges::sort(keys);
    keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
}

void add_blocks(Vec3i first, Vec3i last, std::vector<std::uint64_t>& keys) {
    const Vec3i from = block_of_node(first), to = block_of_node(last);
    for (int z = from.z; z <= to.z; ++z)
        for (int y = from.y; y <= to.y; ++y)
            for (int x = from.x; x <= to.x; ++x) keys.push_back(block_key({x, y, z}));
}

void add_parents(const std::vector<std::uint64_t>& fine, std::vector<std::uint64_t>& coarse) {
    for (const std::uint64_t key : fine) {
        const Vec3i middle = (kBlockEdge / 2) * block_of_key(key);
        add_blocks(middle - Vec3i{1, 1, 1}, middle + Vec3i{4, 4, 4}, coarse);
    }
    sort_unique(coarse);
}

const float* LevelReader::find(int level, Vec3i node) {
    const PoissonLevel& from = levels_[level];
    int& last = blocks_[level];
    const std::uint64_t key = block_key(block_of_node(node));
    if (last >= from.size() || from.keys[last] != key) {
        const int found = find_key({from.keys.data(), from.keys.size()}, key);
        if (found < 0) return nullptr;
        last = found;
    }
    return &from.values[static_cast<std::size_t>(last) * kBlockVoxels +
                        static_cast<std::size_t>(local_of_node(node))];
}

float LevelReader::below(Vec3i node, int level, float beyond) {
    Vec3d p = vec_cast<double>(node);
    for (; level >= 0; --level) {
        // From the nodes of the finer level to the nodes of this one.
        p = 0.5 * (p - Vec3d{0.5, 0.5, 0.5});
        const Vec3i base{static_cast<int>(std::floor(p.x)), static_cast<int>(std::floor(p.y)),
                         static_cast<int>(std::floor(p.z))};
        const Vec3f t = vec_cast<float>(p - vec_cast<double>(base));
        float sum = 0;
        bool complete = true;
        for (int corner = 0; corner < 8 && complete; ++corner) {
            const Vec3i offset{corner & 1, corner >> 1 & 1, corner >> 2};
            const float* value = find(level, base + offset);
            complete = value != nullptr || level == 0;
            sum += (offset.x ? t.x : 1 - t.x) * (offset.y ? t.y : 1 - t.y) *
                   (offset.z ? t.z : 1 - t.z) * (value ? *value : beyond);
        }
        if (complete) return sum;
    }
    return beyond;
}

}  // namespace tvsgs
