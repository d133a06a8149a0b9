#include <algorithm>
#include <array>
#include <utility>

#include "core/device/parallel.h"
#include "mesh/closed/poisson_solve.h"
#include "mesh/fuse/mesh_parts.h"

namespace tvsgs {
namespace {

// Least magnitude at a node, so that no vertex coincides with it.
constexpr float kMinValue = 1e-4f;

/// Whether the nodes of a block and of the layer around it are inside: all nodes of the cells that
/// have a node in the block.
using Around = std::array<bool, kHaloNodes>;

/// Bit d, of 27, is set if a cell that the surface crosses has nodes in the block and in its
/// neighbour in direction d.
int crossed_neighbours(const Around& around) {
    int found = 0;
    Vec3i cell;
    for (cell.z = -1; cell.z < kBlockEdge; ++cell.z)
        for (cell.y = -1; cell.y < kBlockEdge; ++cell.y)
            for (cell.x = -1; cell.x < kBlockEdge; ++cell.x) {
                int inside = 0;
                for (int c = 0; c < 8; ++c) inside += around[halo_index(cell + corner_offset(c))];
                if (inside == 0 || inside == 8) continue;
                for (int c = 0; c < 8; ++c) {
                    const Vec3i p = cell + corner_offset(c);
                    const auto side = [](int i) { return i < 0 ? 0 : i < kBlockEdge ? 1 : 2; };
                    found |= 1 << ((side(p.z) * 3 + side(p.y)) * 3 + side(p.x));
                }
            }
    return found;
}

/// The blocks of all nodes of the cells that the surface crosses, found by a search from the blocks
/// of the finest level.
std::vector<std::uint64_t> crossed_blocks(const PoissonField& field) {
    std::vector<std::uint64_t> all, frontier = field.finest().keys;
    std::vector<std::uint64_t> looked_at = frontier;
    const int last = static_cast<int>(field.levels.size()) - 1;
    while (!frontier.empty()) {
        std::vector<int> crossed(frontier.size());
        parallel_for_heavy(Cpu{}, static_cast<int>(frontier.size()), [&](int i) {
            LevelReader reader(field.levels, last);
            const Vec3i origin = kBlockEdge * block_of_key(frontier[i]);
            Around around;
            Vec3i p;
            for (p.z = -1; p.z <= kBlockEdge; ++p.z)
                for (p.y = -1; p.y <= kBlockEdge; ++p.y)
                    for (p.x = -1; p.x <= kBlockEdge; ++p.x)
                        around[halo_index(p)] = reader.at(origin + p, kOutsideValue) > 0;
            crossed[i] = crossed_neighbours(around);
        });
        std::vector<std::uint64_t> touched, next;
        for (std::size_t i = 0; i < frontier.size(); ++i)
            for (int d = 0; d < 27; ++d)
                if (crossed[i] >> d & 1)
                    touched.push_back(block_key(block_of_key(frontier[i]) +
                                                Vec3i{d % 3 - 1, d / 3 % 3 - 1, d / 9 - 1}));
        sort_unique(touched);
        std::ranges::set_difference(touched, looked_at, std::back_inserter(next));
        const auto add = [](auto& to, const auto& more) {
            to.insert(to.end(), more.begin(), more.end());
            sort_unique(to);
        };
        add(all, touched), add(looked_at, next);
        frontier = std::move(next);
    }
    return all;
}

/// Copies the field at the given blocks into voxels of weight 1.
VoxelBlocks<Cpu> voxels_of(const PoissonField& field, const std::vector<std::uint64_t>& keys) {
    VoxelBlocks<Cpu> blocks;
    blocks.voxel_size = field.finest().spacing;
    copy(keys, blocks.keys);
    blocks.places.resize(keys.size());
    reserve_places(blocks, static_cast<int>(keys.size()));
    const auto chunks = std::as_const(blocks.chunk_table).span();
    parallel_for_heavy(Cpu{}, blocks.size(), [&](int b) {
        blocks.places[b] = b;
        LevelReader reader(field.levels, static_cast<int>(field.levels.size()) - 1);
        const Vec3i origin = kBlockEdge * block_of_key(keys[b]);
        for (int i = 0; i < kBlockVoxels; ++i) {
            const float value = reader.at(origin + local_of_index(i), kOutsideValue);
            voxel_at(chunks, b, i) = {
                value > 0 ? std::min(-value, -kMinValue) : std::max(-value, kMinValue), 1, {}};
        }
    });
    return blocks;
}

}  // namespace

TriangleMesh poisson_surface(const PoissonField& field, std::int64_t max_bytes) {
    constexpr std::int64_t kMaxBlocks = 1'000'000;  // limit of the numbering of edges
    const std::int64_t room = max_bytes / VoxelBlocks<Cpu>::kWorkingBytesPerBlock;
    const std::vector<std::uint64_t> keys = crossed_blocks(field);
    PartPlanner planner(
        keys, static_cast<std::size_t>(max_bytes > 0 ? std::min(room, kMaxBlocks) : kMaxBlocks));
    MeshJoiner joiner(keys);
    for (BlockPart part; planner.next(part);)
        joiner.add(part,
                   marching_cubes_part(voxels_of(field, part.keys), 1, part.first, part.count));
    TriangleMesh mesh = joiner.finish();
    mesh.colors.clear();
    return mesh;
}

}  // namespace tvsgs
