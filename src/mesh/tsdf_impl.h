// The fusion itself, for both devices; tsdf.cpp and tsdf.cu instantiate it.
#pragma once

#include <cmath>
#include <string>

#include "core/error.h"
#include "core/parallel.h"
#include "mesh/device_algorithms.h"
#include "mesh/tsdf.h"

namespace tvsgs {
namespace detail {

inline constexpr std::uint32_t kTooMany = 1u << 31;  // blocks of one pixel, or of one view
inline constexpr int kMaxBlocks = (1 << 22) - 1;     // voxels are counted in int

/// Blocks of pixel i that its left neighbour does not mark as well: most pixels then mark none.
struct PixelBlocks {
    BlockRange own, left;

    TVSGS_HD PixelBlocks(
        const Camera& camera, Span<const float> depth, float truncation, float block_size, int i) {
        const int x = i % camera.width_px, y = i / camera.width_px;
        own = blocks_of_pixel(camera, x, y, depth[i], truncation, block_size);
        if (x > 0) left = blocks_of_pixel(camera, x - 1, y, depth[i - 1], truncation, block_size);
    }
};

struct CountBlocksBody {
    Camera camera;
    Span<const float> depth;
    float truncation, block_size;
    Span<std::uint32_t> counts;  // kTooMany: too many or too far

    TVSGS_HD void operator()(int i) const {
        const PixelBlocks blocks(camera, depth, truncation, block_size, i);
        const std::uint64_t n = count(blocks.own) - count(intersection(blocks.own, blocks.left));
        counts[i] = blocks.own.too_far || n > kTooMany ? kTooMany : static_cast<std::uint32_t>(n);
    }
};

struct EmitBlocksBody {
    Camera camera;
    Span<const float> depth;
    float truncation, block_size;
    Span<const std::uint32_t> offsets;
    Span<std::uint64_t> keys;

    TVSGS_HD void operator()(int i) const {
        const PixelBlocks blocks(camera, depth, truncation, block_size, i);
        const BlockRange& own = blocks.own;
        std::uint32_t place = offsets[i];
        for (int z = own.first.z; z <= own.last.z; ++z)
            for (int y = own.first.y; y <= own.last.y; ++y)
                for (int x = own.first.x; x <= own.last.x; ++x)
                    if (!contains(blocks.left, {x, y, z})) keys[place++] = block_key({x, y, z});
    }
};

struct FlagNewBody {
    Span<const std::uint64_t> keys, view_keys;
    Span<std::uint32_t> is_new;

    TVSGS_HD void operator()(int i) const { is_new[i] = find_key(keys, view_keys[i]) < 0 ? 1 : 0; }
};

/// Slots of a view's blocks; new blocks take the slots after the old ones, in the order of their
/// keys.
struct AssignSlotsBody {
    Span<const std::uint64_t> keys, view_keys;
    Span<const int> slots;
    Span<const std::uint32_t> offsets;  // new blocks before this one
    Span<int> view_slots;
    Span<std::uint64_t> new_keys;

    TVSGS_HD void operator()(int i) const {
        const int found = find_key(keys, view_keys[i]);
        view_slots[i] = found >= 0 ? slots[found] : keys.size() + static_cast<int>(offsets[i]);
        if (found < 0) new_keys[offsets[i]] = view_keys[i];
    }
};

/// Merges two ascending lists without common keys: an element's place is its own plus the number of
/// smaller ones in the other list.
struct MergeBody {
    Span<const std::uint64_t> keys, new_keys;
    Span<const int> slots;
    Span<std::uint64_t> merged_keys;
    Span<int> merged_slots;

    TVSGS_HD void operator()(int i) const {
        const bool old = i < keys.size();
        const int j = old ? i : i - keys.size();
        const std::uint64_t key = old ? keys[j] : new_keys[j];
        const int place = j + lower_bound(old ? new_keys : keys, key);
        merged_keys[place] = key;
        merged_slots[place] = old ? slots[j] : i;
    }
};

struct IntegrateBody {
    Camera camera;
    Span<const float> depth;
    Span<const Vec3f> color;
    float voxel_size, truncation;
    Span<const std::uint64_t> view_keys;
    Span<const int> view_slots;
    Span<Voxel* const> chunks;

    TVSGS_HD void operator()(int i) const {
        const int block = i / kBlockVoxels, local = i % kBlockVoxels;
        const Vec3f p =
            voxel_centre(block_of_key(view_keys[block]), local_of_index(local), voxel_size);
        const Observation seen = observe(camera, depth, truncation, p);
        if (seen.valid)
            fuse(voxel_at(chunks, view_slots[block], local), seen.tsdf, color[seen.pixel]);
    }
};

inline std::string gib(double bytes) {
    const double tenths = std::ceil(bytes / (1 << 30) * 100) / 100;
    return str(tenths, " GiB");
}

}  // namespace detail

template <class Device>
void reserve_slots(VoxelBlocks<Device>& blocks, int count) {
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
        throw Error(ExitCode::usage,
                    str("the voxel size (", options.voxel_size, ") and the truncation (",
                        options.truncation,
                        ") must be positive numbers; give --voxel-size and --truncation"));
    blocks_.voxel_size = options.voxel_size;
}

template <class Device>
void TsdfVolume<Device>::check_memory(std::int64_t count) const {
    const double bytes = static_cast<double>(count) * VoxelBlocks<Device>::kBytesPerBlock;
    const double limit = static_cast<double>(options_.max_bytes);
    if (count <= detail::kMaxBlocks && (options_.max_bytes <= 0 || bytes <= limit)) return;
    // The number of blocks goes with the inverse square of the voxel size; 5 % to spare, two
    // digits.
    const double fit =
        options_.max_bytes > 0
            ? std::min(limit, double(detail::kMaxBlocks) * VoxelBlocks<Device>::kBytesPerBlock)
            : double(detail::kMaxBlocks) * VoxelBlocks<Device>::kBytesPerBlock;
    const double voxel = 1.05 * options_.voxel_size * std::sqrt(bytes / fit);
    const double digit = std::pow(10.0, std::floor(std::log10(voxel)) - 1);
    throw Error(ExitCode::memory,
                str("the volume needs at least ", detail::gib(bytes), " for ", count,
                    " blocks (voxel size ", options_.voxel_size, ", truncation ",
                    options_.truncation, "), but may use ", detail::gib(fit), "; try --voxel-size ",
                    std::ceil(voxel / digit) * digit,
                    ", a smaller --depth-max or --bbox, or raise --memory"));
}

template <class Device>
void TsdfVolume<Device>::mark_blocks(const DepthView<Device>& view) {
    const Camera& camera = view.camera;
    const int pixels = camera.width_px * camera.height_px;
    const float block_size = options_.voxel_size * kBlockEdge;
    offsets_.resize(static_cast<std::size_t>(pixels));
    parallel_for(Device{}, pixels,
                 detail::CountBlocksBody{camera, view.depth, options_.truncation, block_size,
                                         offsets_.span()});
    const std::uint64_t total = exclusive_scan(offsets_);
    if (total >= detail::kTooMany) {
        // Why? Look again on the host; only this message needs to know.
        std::vector<float> depth(view.depth.count);
        tvsgs::detail::copy(Device{}, view.depth.data, Cpu{}, depth.data(),
                            depth.size() * sizeof(float));
        for (int i = 0; i < pixels; ++i) {
            const int x = i % camera.width_px, y = i / camera.width_px;
            const float d = depth[static_cast<std::size_t>(i)];
            if (blocks_of_pixel(camera, x, y, d, options_.truncation, block_size).too_far)
                throw Error(ExitCode::input,
                            str("pixel (", x, ", ", y, ") has depth ", d, ", which lies more than ",
                                kBlockReach * static_cast<double>(block_size),
                                " from the origin, beyond the volume's reach; lower --depth-max or "
                                "raise --voxel-size"));
        }
        throw Error(
            ExitCode::usage,
            str("a truncation of ", options_.truncation, " marks too many blocks of ", kBlockEdge,
                " voxels of ", options_.voxel_size, "; lower --truncation or raise --voxel-size"));
    }
    view_keys_.resize(total);
    parallel_for(Device{}, pixels,
                 detail::EmitBlocksBody{camera, view.depth, options_.truncation, block_size,
                                        offsets_.span(), view_keys_.span()});
    sort_unique(view_keys_);
}

template <class Device>
void TsdfVolume<Device>::add_blocks() {
    const int marked = static_cast<int>(view_keys_.size());
    const int old_count = blocks_.size();
    offsets_.resize(view_keys_.size());
    view_slots_.resize(view_keys_.size());
    parallel_for(Device{}, marked,
                 detail::FlagNewBody{blocks_.keys.span(), view_keys_.span(), offsets_.span()});
    const int new_count = static_cast<int>(exclusive_scan(offsets_));
    check_memory(std::int64_t{old_count} + new_count);
    const int merged_count = old_count + new_count;
    reserve_slots(blocks_, merged_count);

    new_keys_.resize(static_cast<std::size_t>(new_count));
    parallel_for(
        Device{}, marked,
        detail::AssignSlotsBody{blocks_.keys.span(), view_keys_.span(), blocks_.slots.span(),
                                offsets_.span(), view_slots_.span(), new_keys_.span()});
    if (new_count == 0) return;
    merged_keys_.resize(static_cast<std::size_t>(merged_count));
    merged_slots_.resize(static_cast<std::size_t>(merged_count));
    parallel_for(Device{}, merged_count,
                 detail::MergeBody{blocks_.keys.span(), new_keys_.span(), blocks_.slots.span(),
                                   merged_keys_.span(), merged_slots_.span()});
    blocks_.keys.swap(merged_keys_);
    blocks_.slots.swap(merged_slots_);
}

template <class Device>
void TsdfVolume<Device>::integrate(const DepthView<Device>& view) {
    const std::size_t pixels = static_cast<std::size_t>(view.camera.width_px) *
                               static_cast<std::size_t>(view.camera.height_px);
    if (view.depth.count != pixels || view.color.count != pixels)
        throw Error(ExitCode::internal, str("fusion: ", view.depth.count, " depths and ",
                                            view.color.count, " colours for ", pixels, " pixels"));
    mark_blocks(view);
    add_blocks();
    // Blocks that the view touches; few enough for int, see kMaxBlocks.
    parallel_for(Device{}, static_cast<int>(view_keys_.size()) * kBlockVoxels,
                 detail::IntegrateBody{view.camera, view.depth, view.color, options_.voxel_size,
                                       options_.truncation, view_keys_.span(), view_slots_.span(),
                                       std::as_const(blocks_.chunk_table).span()});
}

}  // namespace tvsgs
