// Marching cubes for both devices. Every voxel owns the cell above it and the three edges that
// start there, so vertices are unique without a search.
#pragma once

#include "core/device/parallel.h"
#include "core/error.h"
#include "mesh/fuse/device_algorithms.h"
#include "mesh/fuse/marching_cubes_table.h"
#include "mesh/fuse/mesh_parts.h"

namespace tvsgs {
namespace detail {

/// Finds the 27 blocks around each block, itself included; -1: absent.
struct NeighboursBody {
    Span<const std::uint64_t> keys;
    Span<int> neighbours;  // [B 27]

    TVSGS_HD void operator()(int i) const {
        const int which = i % 27;
        const Vec3i p =
            block_of_key(keys[i / 27]) + Vec3i{which % 3 - 1, which / 3 % 3 - 1, which / 9 - 1};
        const auto in_reach = [](int c) { return c >= -kBlockReach && c < kBlockReach; };
        neighbours[i] =
            in_reach(p.x) && in_reach(p.y) && in_reach(p.z) ? find_key(keys, block_key(p)) : -1;
    }
};

/// Addresses voxels by number (block * 512 + local), and their neighbours.
struct VoxelGrid {
    Span<const std::uint64_t> keys;
    Span<const int> places, neighbours;
    Span<Voxel* const> chunks;
    float voxel_size;
    Contraction<float> contraction;

    /// Number of the voxel at `offset` (entries -1, 0, 1); -1 if its block is absent.
    TVSGS_HD int moved(int voxel, Vec3i offset) const {
        const Vec3i local = local_of_index(voxel % kBlockVoxels) + offset;
        const auto step = [](int c) { return c < 0 ? 0 : c < kBlockEdge ? 1 : 2; };
        const auto wrap = [](int c) { return (c + kBlockEdge) % kBlockEdge; };
        const int which = (step(local.z) * 3 + step(local.y)) * 3 + step(local.x);
        const int block = neighbours[std::size_t(voxel / kBlockVoxels) * 27 + which];
        return block < 0 ? -1
                         : block * kBlockVoxels +
                               local_index({wrap(local.x), wrap(local.y), wrap(local.z)});
    }
    TVSGS_HD const Voxel& value(int voxel) const {
        return voxel_at(chunks, places[voxel / kBlockVoxels], voxel % kBlockVoxels);
    }
    TVSGS_HD Vec3f centre(int voxel) const {
        return voxel_centre(block_of_key(keys[voxel / kBlockVoxels]),
                            local_of_index(voxel % kBlockVoxels), voxel_size);
    }
};

/// The range of blocks to mesh.
struct BlockRun {
    int first, count;

    TVSGS_HD bool has_voxel(int voxel) const {
        return voxel / kBlockVoxels >= first && voxel / kBlockVoxels < first + count;
    }
};

TVSGS_HD inline Vec3i axis_offset(int axis) {
    return {axis == 0, axis == 1, axis == 2};
}

/// The case of each cell; 0 if a corner is unknown.
struct CasesBody {
    VoxelGrid grid;
    Span<const CubeCase> table;
    float min_weight;
    BlockRun own;
    Span<std::uint8_t> cases;
    Span<std::uint32_t> triangle_counts;

    TVSGS_HD int cell_case(int voxel) const {
        int inside = 0;
        for (int corner = 0; corner < kCubeCorners; ++corner) {
            const int at = grid.moved(voxel, corner_offset(corner));
            if (at < 0) return 0;
            const Voxel& v = grid.value(at);
            if (!(v.weight >= min_weight && v.weight > 0)) return 0;
            if (v.tsdf < 0) inside |= 1 << corner;
        }
        return inside;
    }
    TVSGS_HD void operator()(int voxel) const {
        const int inside = cell_case(voxel);
        cases[voxel] = static_cast<std::uint8_t>(inside);
        triangle_counts[voxel] =
            own.has_voxel(voxel) ? static_cast<std::uint32_t>(table[inside].triangles) : 0;
    }
};

/// Marks which of a voxel's three edges carry a vertex: crossed edges of cells with a case.
struct EdgesBody {
    VoxelGrid grid;
    BlockRun own;
    Span<const std::uint8_t> cases;
    Span<std::uint8_t> edges;  // bit per axis
    Span<std::uint32_t> vertex_counts;

    TVSGS_HD bool crossed(int voxel, int axis) const {
        const Vec3i side = axis_offset((axis + 1) % 3), up = axis_offset((axis + 2) % 3);
        for (int k = 0; k < 4; ++k) {
            const Vec3i offset = (k & 1 ? -side : Vec3i{}) + (k >> 1 ? -up : Vec3i{});
            const int cell = grid.moved(voxel, offset);
            if (cell < 0 || cases[cell] == 0) continue;
            const int corner = (k & 1) << (axis + 1) % 3 | (k >> 1) << (axis + 2) % 3;
            return (cases[cell] >> corner & 1) != (cases[cell] >> (corner | 1 << axis) & 1);
        }
        return false;
    }
    TVSGS_HD void operator()(int voxel) const {
        int flags = 0, count = 0;
        for (int axis = 0; axis < 3; ++axis)
            if (own.has_voxel(voxel) && crossed(voxel, axis)) flags |= 1 << axis, ++count;
        edges[voxel] = static_cast<std::uint8_t>(flags);
        vertex_counts[voxel] = static_cast<std::uint32_t>(count);
    }
};

struct VerticesBody {
    VoxelGrid grid;
    Span<const std::uint8_t> edges;
    Span<const std::uint32_t> offsets;
    Span<Vec3f> positions, colors;
    Span<std::uint16_t> owner_edges;

    TVSGS_HD void operator()(int voxel) const {
        std::uint32_t place = offsets[voxel];
        for (int axis = 0; axis < 3; ++axis) {
            if (!(edges[voxel] >> axis & 1)) continue;
            const Voxel& a = grid.value(voxel);
            const Voxel& b = grid.value(grid.moved(voxel, axis_offset(axis)));
            // Exactly one of the two is negative, so the sum is not zero.
            const float distance_a = std::fabs(a.tsdf), distance_b = std::fabs(b.tsdf);
            const float t = distance_a / (distance_a + distance_b);
            Vec3f p = grid.centre(voxel);
            p[axis] += t * grid.voxel_size;
            positions[place] = grid.contraction.expand(p);
            owner_edges[place] = static_cast<std::uint16_t>(voxel % kBlockVoxels * 3 + axis);
            colors[place++] = (1 - t) * a.color + t * b.color;
        }
    }
};

struct FirstVerticesBody {
    int first;
    Span<const std::uint32_t> offsets;
    Span<std::uint32_t> firsts;

    TVSGS_HD void operator()(int i) const { firsts[i] = offsets[(first + i) * kBlockVoxels]; }
};

struct FacesBody {
    VoxelGrid grid;
    BlockRun own;
    Span<const CubeCase> table;
    Span<const std::uint8_t> cases, edges;
    Span<const std::uint32_t> vertex_offsets, triangle_offsets;
    Span<Vec3i> faces;

    TVSGS_HD int vertex(int cell, int edge) const {
        const int axis = edge_axis(edge);
        const int owner = grid.moved(cell, corner_offset(edge_corner(edge)));
        if (!own.has_voxel(owner)) return ~(owner * 3 + axis);
        int place = static_cast<int>(vertex_offsets[owner]);
        for (int before = 0; before < axis; ++before) place += edges[owner] >> before & 1;
        return place;
    }
    TVSGS_HD void operator()(int cell) const {
        if (!own.has_voxel(cell)) return;
        const CubeCase& c = table[cases[cell]];
        for (int k = 0; k < c.triangles; ++k)
            faces[triangle_offsets[cell] + k] = {vertex(cell, c.edges[3 * k]),
                                                 vertex(cell, c.edges[3 * k + 1]),
                                                 vertex(cell, c.edges[3 * k + 2])};
    }
};

}  // namespace detail

template <class Device>
MeshPart marching_cubes_part(const VoxelBlocks<Device>& blocks,
                             float min_weight,
                             int first,
                             int count) {
    using namespace detail;
    MeshPart part;
    if (blocks.size() == 0) return part;
    const auto table_host = marching_cubes_table();
    const auto table =
        to_device<Device>(std::vector<CubeCase>(table_host.begin(), table_host.end()));
    const int voxels = blocks.size() * kBlockVoxels;  // TsdfVolume keeps this within int

    Buffer<int, Device> neighbours(std::size_t(blocks.size()) * 27);
    parallel_for(Device{}, blocks.size() * 27,
                 NeighboursBody{blocks.keys.span(), neighbours.span()});
    const VoxelGrid grid{blocks.keys.span(),        blocks.places.span(), neighbours.span(),
                         blocks.chunk_table.span(), blocks.voxel_size,    blocks.contraction};

    const BlockRun own{first, count};
    Buffer<std::uint8_t, Device> cases(voxels), edges(voxels);
    Buffer<std::uint32_t, Device> triangle_offsets(voxels), vertex_offsets(voxels);
    parallel_for(
        Device{}, voxels,
        CasesBody{grid, table.span(), min_weight, own, cases.span(), triangle_offsets.span()});
    parallel_for(Device{}, voxels,
                 EdgesBody{grid, own, cases.span(), edges.span(), vertex_offsets.span()});
    const std::uint64_t triangle_count = exclusive_scan(triangle_offsets);
    const std::uint64_t vertex_count = exclusive_scan(vertex_offsets);
    if (triangle_count >= 1u << 31 || vertex_count >= 1u << 31)
        throw_mesh_too_large(vertex_count, triangle_count);

    Buffer<Vec3f, Device> positions(vertex_count), colors(vertex_count);
    Buffer<std::uint16_t, Device> owner_edges(vertex_count);
    parallel_for(Device{}, voxels,
                 VerticesBody{grid, edges.span(), vertex_offsets.span(), positions.span(),
                              colors.span(), owner_edges.span()});
    part.mesh.vertices = to_host(positions);
    part.mesh.colors = to_host(colors);
    part.edges = to_host(owner_edges);
    Buffer<std::uint32_t, Device> firsts(static_cast<std::size_t>(count));
    parallel_for(Device{}, count, FirstVerticesBody{first, vertex_offsets.span(), firsts.span()});
    part.block_vertices = to_host(firsts);
    Buffer<Vec3i, Device> faces(triangle_count);
    parallel_for(Device{}, voxels,
                 FacesBody{grid, own, table.span(), cases.span(), edges.span(),
                           vertex_offsets.span(), triangle_offsets.span(), faces.span()});
    part.mesh.faces = to_host(faces);
    return part;
}

}  // namespace tvsgs
