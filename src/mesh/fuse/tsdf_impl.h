// TSDF fusion for both devices; tsdf.cpp and tsdf.cu instantiate it.
#pragma once

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/device/parallel.h"
#include "core/error.h"
#include "core/scene/view_frustum.h"
#include "mesh/fuse/device_algorithms.h"
#include "mesh/fuse/pixel_trust.h"
#include "mesh/fuse/tsdf.h"

namespace tvsgs {
namespace detail {

inline constexpr std::uint32_t kTooMany = 1u << 31;  // blocks of one pixel, or of one view
inline constexpr int kMaxBlocks = (1 << 22) - 1;     // voxels are counted in int
inline constexpr int kMaxPartBlocks = 1'000'000;     // edges of a part's voxels are counted in int

/// Blocks that pixel i marks and its left neighbour does not; usually none.
struct PixelBlocks {
    BlockRange own, left;

    TVSGS_HD PixelBlocks(const Camera& camera,
                         Span<const float> depth,
                         const VoxelSpace& space,
                         int i) {
        const int x = i % camera.width_px, y = i / camera.width_px;
        own = blocks_of_pixel(camera, x, y, depth[i], space);
        if (x > 0) left = blocks_of_pixel(camera, x - 1, y, depth[i - 1], space);
    }
};

struct CountBlocksBody {
    Camera camera;
    Span<const float> depth;
    VoxelSpace space;
    Span<std::uint32_t> counts;  // kTooMany: too many or too far

    TVSGS_HD void operator()(int i) const {
        const PixelBlocks blocks(camera, depth, space, i);
        const std::uint64_t n = count(blocks.own) - count(intersection(blocks.own, blocks.left));
        counts[i] = blocks.own.too_far || n > kTooMany ? kTooMany : static_cast<std::uint32_t>(n);
    }
};

struct EmitBlocksBody {
    Camera camera;
    Span<const float> depth;
    VoxelSpace space;
    Span<const std::uint32_t> offsets;
    Span<std::uint64_t> keys;

    TVSGS_HD void operator()(int i) const {
        const PixelBlocks blocks(camera, depth, space, i);
        const BlockRange& own = blocks.own;
        std::uint32_t at = offsets[i];
        for (int z = own.first.z; z <= own.last.z; ++z)
            for (int y = own.first.y; y <= own.last.y; ++y)
                for (int x = own.first.x; x <= own.last.x; ++x)
                    if (!contains(blocks.left, {x, y, z})) keys[at++] = block_key({x, y, z});
    }
};

struct FlagNewBody {
    Span<const std::uint64_t> keys, view_keys;
    Span<std::uint32_t> is_new;

    TVSGS_HD void operator()(int i) const { is_new[i] = find_key(keys, view_keys[i]) < 0 ? 1 : 0; }
};

/// Finds the places of a view's blocks. New blocks take the next places, in the order of their
/// keys.
struct AssignPlacesBody {
    Span<const std::uint64_t> keys, view_keys;
    Span<const int> places;
    Span<const std::uint32_t> offsets;  // number of new blocks before this one
    Span<int> view_places;
    Span<std::uint64_t> new_keys;

    TVSGS_HD void operator()(int i) const {
        const int found = find_key(keys, view_keys[i]);
        view_places[i] = found >= 0 ? places[found] : keys.size() + static_cast<int>(offsets[i]);
        if (found < 0) new_keys[offsets[i]] = view_keys[i];
    }
};

/// Finds the places of existing blocks.
struct FindPlacesBody {
    Span<const std::uint64_t> keys, view_keys;
    Span<const int> places;
    Span<int> view_places;

    TVSGS_HD void operator()(int i) const { view_places[i] = places[find_key(keys, view_keys[i])]; }
};

/// Merges two ascending lists without common keys. The position of an element is its index plus the
/// number of smaller elements in the other list.
struct MergeBody {
    Span<const std::uint64_t> keys, new_keys;
    Span<const int> places;
    Span<std::uint64_t> merged_keys;
    Span<int> merged_places;

    TVSGS_HD void operator()(int i) const {
        const bool old = i < keys.size();
        const int j = old ? i : i - keys.size();
        const std::uint64_t key = old ? keys[j] : new_keys[j];
        const int position = j + lower_bound(old ? new_keys : keys, key);
        merged_keys[position] = key;
        merged_places[position] = old ? places[j] : i;
    }
};

struct IntegrateBody {
    Camera camera;
    Span<const float> depth;
    Span<const Vec3f> color;
    Span<const float> weight;
    VoxelSpace space;
    Span<const std::uint64_t> view_keys;
    Span<const int> view_places;
    Span<Voxel* const> chunks;

    TVSGS_HD void operator()(int i) const {
        const int block = i / kBlockVoxels, local = i % kBlockVoxels;
        const Vec3f p =
            voxel_centre(block_of_key(view_keys[block]), local_of_index(local), space.voxel_size);
        const Observation seen = observe(camera, depth, space, space.contraction.expand(p));
        if (seen.valid)
            fuse(voxel_at(chunks, view_places[block], local), seen.tsdf, color[seen.pixel],
                 weight.empty() ? 1 : weight[seen.pixel]);
    }
};

/// Marks the blocks that may contain a point in view.
struct InViewBody {
    ViewFrustum limits;
    float voxel_size;
    Span<const std::uint64_t> keys;
    Span<std::uint32_t> counts;

    TVSGS_HD void operator()(int i) const {
        const Vec3i block = block_of_key(keys[i]);
        const float edge = kBlockEdge * voxel_size;
        const Vec3f low{edge * static_cast<float>(block.x), edge * static_cast<float>(block.y),
                        edge * static_cast<float>(block.z)};
        counts[i] = !limits.misses({low, low + Vec3f{edge, edge, edge}});
    }
};

struct ListBlocksBody {
    Span<const std::uint32_t> offsets;
    std::uint32_t total;
    Span<int> listed;

    TVSGS_HD void operator()(int i) const {
        const std::uint32_t next = i + 1 < offsets.size() ? offsets[i + 1] : total;
        if (next != offsets[i]) listed[static_cast<int>(offsets[i])] = i;
    }
};

/// Clears voxels that one view alone has created and another view looks through.
struct ContradictBody {
    Camera camera;
    Span<const float> depth, weight;
    VoxelSpace space;
    Span<const std::uint64_t> keys;
    Span<const int> places;
    Span<const int> listed;  // blocks to check; empty: all
    Span<Voxel* const> chunks;

    TVSGS_HD void operator()(int i) const {
        const int at = i / kBlockVoxels, local = i % kBlockVoxels;
        const int block = listed.empty() ? at : listed[at];
        Voxel& voxel = voxel_at(chunks, places[block], local);
        if (voxel.weight != kTrustedWeight) return;
        const Vec3f p =
            voxel_centre(block_of_key(keys[block]), local_of_index(local), space.voxel_size);
        const Observation seen = observe(camera, depth, space, space.contraction.expand(p));
        if (seen.valid && seen.tsdf == 1 && weight[seen.pixel] == kTrustedWeight) voxel.weight = 0;
    }
};

}  // namespace detail

template <class Device>
void reserve_places(VoxelBlocks<Device>& blocks, int count) {
    constexpr int kChunk = VoxelBlocks<Device>::kChunkBlocks;
    const std::size_t wanted = static_cast<std::size_t>((count + kChunk - 1) / kChunk);
    if (wanted <= blocks.chunks.size()) return;
    while (blocks.chunks.size() < wanted) {
        Buffer<Voxel, Device> chunk(static_cast<std::size_t>(kChunk) * kBlockVoxels);
        chunk.fill_zero();
        blocks.chunks.push_back(std::move(chunk));
    }
    std::vector<Voxel*> addresses;
    for (auto& chunk : blocks.chunks) addresses.push_back(chunk.data());
    copy(addresses, blocks.chunk_table);
}

template <class Device>
TsdfVolume<Device>::TsdfVolume(const TsdfOptions& options) : options_(options) {
    if (!(options.voxel_size > 0 && std::isfinite(options.voxel_size) && options.truncation > 0 &&
          std::isfinite(options.truncation)))
        throw Error(ExitCode::usage, "the voxel size (", options.voxel_size,
                    ") and the truncation (", options.truncation,
                    ") must be positive; pass --voxel-size and --truncation");
    const float radius = options.contraction.radius;
    if (options.contraction.is_on() && !(options.truncation < radius && std::isfinite(radius)))
        throw Error(ExitCode::usage, "truncation ", options.truncation,
                    " is too large for an unbounded scene with a ball of radius ", radius,
                    "; lower --voxel-size or --truncation");
    clear();
}

template <class Device>
bool TsdfVolume<Device>::fits(std::int64_t count) const {
    constexpr std::int64_t kChunk = VoxelBlocks<Device>::kChunkBlocks;
    const std::int64_t allocated = (count + kChunk - 1) / kChunk * kChunk;
    return count <= detail::kMaxBlocks &&
           (options_.max_bytes <= 0 ||
            allocated * VoxelBlocks<Device>::kWorkingBytesPerBlock <= options_.max_bytes);
}

template <class Device>
void TsdfVolume<Device>::mark_blocks(const DepthView<Device>& view) {
    const Camera& camera = view.camera;
    const int pixels = camera.width_px * camera.height_px;
    const auto expected = static_cast<std::size_t>(pixels);
    if (view.depth.count != expected || view.color.count != expected ||
        (!view.weight.empty() && view.weight.count != expected))
        throw Error(ExitCode::internal, "fusion: ", view.depth.count, " depths, ", view.color.count,
                    " colours and ", view.weight.count, " weights for ", pixels, " pixels");
    const VoxelSpace space = options_.space();
    offsets_.resize(static_cast<std::size_t>(pixels));
    parallel_for(Device{}, pixels,
                 detail::CountBlocksBody{camera, view.depth, space, offsets_.span()});
    const std::uint64_t total = exclusive_scan(offsets_);
    if (total >= detail::kTooMany) {
        // Finds the cause on the host, for the error message only.
        const std::vector<float> depth = map_on_host(Device{}, view.depth);
        for (int i = 0; i < pixels; ++i) {
            const int x = i % camera.width_px, y = i / camera.width_px;
            const float d = depth[i];
            if (blocks_of_pixel(camera, x, y, d, space).too_far)
                throw Error(ExitCode::input, "pixel (", x, ", ", y, ") has depth ", d,
                            ", which lies more than ",
                            kBlockReach * static_cast<double>(kBlockEdge * space.voxel_size),
                            " from the origin, beyond the volume's reach; lower --depth-max or "
                            "raise --voxel-size");
        }
        throw Error(ExitCode::usage, "a truncation of ", options_.truncation,
                    " marks too many blocks of ", kBlockEdge, " voxels of ", options_.voxel_size,
                    "; lower --truncation or raise --voxel-size");
    }
    view_keys_.resize(total);
    parallel_for(
        Device{}, pixels,
        detail::EmitBlocksBody{camera, view.depth, space, offsets_.span(), view_keys_.span()});
    sort_unique(view_keys_);
}

template <class Device>
bool TsdfVolume<Device>::add_blocks() {
    const int marked = static_cast<int>(view_keys_.size());
    const int old_count = blocks_.size();
    offsets_.resize(view_keys_.size());
    view_places_.resize(view_keys_.size());
    parallel_for(Device{}, marked,
                 detail::FlagNewBody{blocks_.keys.span(), view_keys_.span(), offsets_.span()});
    const int new_count = static_cast<int>(exclusive_scan(offsets_));
    if (!fits(std::int64_t{old_count} + new_count)) return false;
    const int merged_count = old_count + new_count;
    reserve_places(blocks_, merged_count);

    new_keys_.resize(static_cast<std::size_t>(new_count));
    parallel_for(
        Device{}, marked,
        detail::AssignPlacesBody{blocks_.keys.span(), view_keys_.span(), blocks_.places.span(),
                                 offsets_.span(), view_places_.span(), new_keys_.span()});
    if (new_count == 0) return true;
    merged_keys_.resize(static_cast<std::size_t>(merged_count));
    merged_places_.resize(static_cast<std::size_t>(merged_count));
    parallel_for(Device{}, merged_count,
                 detail::MergeBody{blocks_.keys.span(), new_keys_.span(), blocks_.places.span(),
                                   merged_keys_.span(), merged_places_.span()});
    blocks_.keys.swap(merged_keys_);
    blocks_.places.swap(merged_places_);
    return true;
}

template <class Device>
void TsdfVolume<Device>::fuse_marked(const DepthView<Device>& view) {
    // Few enough for int, see kMaxBlocks.
    parallel_for(
        Device{}, static_cast<int>(view_keys_.size()) * kBlockVoxels,
        detail::IntegrateBody{view.camera, view.depth, view.color, view.weight, options_.space(),
                              view_keys_.span(), view_places_.span(), blocks_.chunk_table.span()});
}

template <class Device>
bool TsdfVolume<Device>::integrate(const DepthView<Device>& view) {
    mark_blocks(view);
    if (!add_blocks()) return false;
    if (!options_.carve) fuse_marked(view);
    return true;
}

template <class Device>
std::vector<std::uint64_t> TsdfVolume<Device>::touched_blocks(const DepthView<Device>& view) {
    mark_blocks(view);
    return to_host(view_keys_);
}

template <class Device>
std::size_t TsdfVolume<Device>::part_capacity() const {
    if (options_.max_bytes <= 0) return detail::kMaxPartBlocks;
    return static_cast<std::size_t>(std::min<std::int64_t>(
        options_.max_bytes / VoxelBlocks<Device>::kWorkingBytesPerBlock, detail::kMaxPartBlocks));
}

template <class Device>
void TsdfVolume<Device>::start_part(const std::vector<std::uint64_t>& keys) {
    if (keys.size() > part_capacity())
        throw Error(ExitCode::internal, "a part of ", keys.size(), " blocks");
    copy(keys, blocks_.keys);
    std::vector<int> places(keys.size());
    std::iota(places.begin(), places.end(), 0);
    copy(places, blocks_.places);
    // Unlike in a growing volume, the last chunk is no larger than needed.
    std::size_t room = 0;
    for (const auto& chunk : blocks_.chunks) room += chunk.size() / kBlockVoxels;
    if (room < keys.size()) {
        blocks_.chunks.clear();
        std::vector<Voxel*> addresses;
        for (std::size_t left = keys.size(), next; left > 0; left -= next) {
            next = std::min<std::size_t>(left, VoxelBlocks<Device>::kChunkBlocks);
            blocks_.chunks.emplace_back(next * kBlockVoxels);
            addresses.push_back(blocks_.chunks.back().data());
        }
        copy(addresses, blocks_.chunk_table);
    }
    for (auto& chunk : blocks_.chunks) chunk.fill_zero();
}

template <class Device>
void TsdfVolume<Device>::integrate_into(const DepthView<Device>& view,
                                        const std::vector<std::uint64_t>& keys) {
    copy(keys, view_keys_);
    view_places_.resize(keys.size());
    parallel_for(Device{}, static_cast<int>(keys.size()),
                 detail::FindPlacesBody{blocks_.keys.span(), view_keys_.span(),
                                        blocks_.places.span(), view_places_.span()});
    fuse_marked(view);
}

template <class Device>
void TsdfVolume<Device>::contradict(const DepthView<Device>& view) {
    const int all = blocks_.size();
    int count = all;
    view_blocks_.resize(0);
    // Blocks are boxes in the world only without contraction.
    if (!options_.contraction.is_on() && all > 0) {
        offsets_.resize(static_cast<std::size_t>(all));
        parallel_for(Device{}, all,
                     detail::InViewBody{ViewFrustum(view.camera), options_.voxel_size,
                                        blocks_.keys.span(), offsets_.span()});
        count = static_cast<int>(exclusive_scan(offsets_));
        if (count == 0) return;
        view_blocks_.resize(static_cast<std::size_t>(count));
        parallel_for(Device{}, all,
                     detail::ListBlocksBody{offsets_.span(), static_cast<std::uint32_t>(count),
                                            view_blocks_.span()});
    }
    parallel_for(Device{}, count * kBlockVoxels,
                 detail::ContradictBody{view.camera, view.depth, view.weight, options_.space(),
                                        blocks_.keys.span(), blocks_.places.span(),
                                        view_blocks_.span(), blocks_.chunk_table.span()});
}

template <class Device>
void TsdfVolume<Device>::clear() {
    blocks_ = {};
    blocks_.voxel_size = options_.voxel_size;
    blocks_.contraction = options_.contraction;
}

}  // namespace tvsgs
