// Fusion of depth maps into a sparse truncated signed distance volume.
#pragma once

#include <vector>

#include "mesh/fuse/depth_view.h"
#include "mesh/fuse/tsdf_math.h"

namespace tvsgs {

/// Voxels in blocks of 8^3. Chunks of blocks let the volume grow without moving or copying voxels.
template <class Device>
struct VoxelBlocks {
    static constexpr int kChunkBlocks = 1024;
    static constexpr std::int64_t kBytesPerBlock = kBlockVoxels * sizeof(Voxel);
    /// With lists, marching cubes and the mesh.
    static constexpr std::int64_t kWorkingBytesPerBlock = 8 * kBytesPerBlock / 5;

    float voxel_size = 0;  // world units, in contracted space
    Contraction<float> contraction;
    Buffer<std::uint64_t, Device> keys;  // [B] ascending block keys
    Buffer<int, Device> places;          // [B] place of each block's voxels
    std::vector<Buffer<Voxel, Device>> chunks;
    Buffer<Voxel*, Device> chunk_table;  // addresses of the chunks

    int size() const { return static_cast<int>(keys.size()); }
};

TVSGS_HD inline Voxel& voxel_at(Span<Voxel* const> chunk_table, int place, int local) {
    constexpr int kChunk = VoxelBlocks<Cpu>::kChunkBlocks;
    return chunk_table[place / kChunk][(place % kChunk) * kBlockVoxels + local];
}

/// Makes room for the voxels of `count` blocks, in whole chunks; new voxels are empty.
template <class Device>
void reserve_places(VoxelBlocks<Device>& blocks, int count);

struct TsdfOptions {
    float voxel_size = 0;                 // world units
    float truncation = 0;                 // world units
    std::int64_t max_bytes = 0;           // limit of voxels and marching cubes; 0: no limit
    Contraction<float> contraction = {};  // of an unbounded scene
    bool carve = false;  // views update all voxels that they see, not only those near their surface
    // Weights come from mesh/fuse/pixel_trust.h; contradict() follows the last view.
    bool trust = false;

    VoxelSpace space() const { return {voxel_size, truncation, contraction}; }
};

/// Fuses views one after the other by the rule of Open3D's legacy volume: makes the blocks within
/// the truncation of a view's depth points and updates only those with that view. The result
/// depends on the views and, in the last bits, on their order; both devices give the same bits.
template <class Device>
class TsdfVolume {
public:
    /// Throws Error(ExitCode::usage) unless voxel size and truncation are positive, and the
    /// truncation less than the radius of a contraction.
    explicit TsdfVolume(const TsdfOptions& options);

    /// False if the blocks would not fit into max_bytes. Throws Error(ExitCode::input) for points
    /// outside of the volume's reach. The volume is unchanged in both cases. With options.carve
    /// this only makes the blocks: after the last view, call integrate_into() for each view.
    [[nodiscard]] bool integrate(const DepthView<Device>& view);

    // For fusion in parts (mesh/fuse/fusion.h).
    /// The keys of the blocks that a view touches, ascending.
    std::vector<std::uint64_t> touched_blocks(const DepthView<Device>& view);
    /// The most blocks of a part.
    std::size_t part_capacity() const;
    /// Replaces the volume by an empty one of the given blocks, ascending.
    void start_part(const std::vector<std::uint64_t>& keys);
    /// Fuses a view into the given blocks, which must be in the volume.
    void integrate_into(const DepthView<Device>& view, const std::vector<std::uint64_t>& keys);

    /// Call for each view after all views are fused: clears voxels that rest on one trusted pixel
    /// alone and lie, by more than the truncation, in the free space of another view.
    void contradict(const DepthView<Device>& view);

    /// Frees the memory of the voxels.
    void clear();

    const VoxelBlocks<Device>& blocks() const { return blocks_; }
    std::int64_t bytes() const { return blocks_.size() * VoxelBlocks<Device>::kBytesPerBlock; }

private:
    void mark_blocks(const DepthView<Device>& view);  // fills view_keys_
    bool add_blocks();                                // view_keys_ into blocks_; fills view_places_
    void fuse_marked(const DepthView<Device>& view);  // into the blocks of view_places_
    bool fits(std::int64_t blocks) const;

    TsdfOptions options_;
    VoxelBlocks<Device> blocks_;
    // Scratch.
    Buffer<std::uint64_t, Device> view_keys_, merged_keys_, new_keys_;
    Buffer<int, Device> view_places_, merged_places_, view_blocks_;
    Buffer<std::uint32_t, Device> offsets_;
};

}  // namespace tvsgs
