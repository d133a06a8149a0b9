// Fuses depth maps into one mesh within a memory limit.
#pragma once

#include <algorithm>
#include <filesystem>
#include <functional>
#include <string>

#include "core/error.h"
#include "core/scratch_file.h"
#include "mesh/fuse/mesh_parts.h"

namespace tvsgs {

struct FusionReport {
    std::int64_t blocks = 0, bytes = 0;  // of voxels, over all parts
    int parts = 1;
    std::int64_t spilled_bytes = 0;
};

namespace detail {

/// Stores arrays that do not fit into memory in a scratch file, one after the other. All functions
/// throw Error(ExitCode::io).
class SpillFile {
public:
    /// Makes the folder if it does not exist.
    explicit SpillFile(const std::string& folder) : file_(made(folder), kPurpose) {}

    struct Place {
        std::int64_t offset = 0;
        std::size_t count = 0;
    };

    template <class T>
    Place append(const T* values, std::size_t count) {
        const Place place{bytes_, count};
        file_.write(bytes_, values, count * sizeof(T));
        bytes_ += static_cast<std::int64_t>(count * sizeof(T));
        return place;
    }
    template <class T>
    void read(Place place, std::vector<T>& values) const {
        values.resize(place.count);
        file_.read(place.offset, values.data(), place.count * sizeof(T));
    }
    std::int64_t bytes() const { return bytes_; }

private:
    static constexpr const char* kPurpose =
        "what does not fit into --memory is kept in this folder for a while";

    /// Ignores a failure, because creating the file reports it.
    static const std::string& made(const std::string& folder) {
        std::error_code code;
        std::filesystem::create_directories(folder, code);
        return folder;
    }

    ScratchFile file_;
    std::int64_t bytes_ = 0;
};

/// Stores the views' maps on disk, then fuses each part from the views that touch it.
template <class Device>
TriangleMesh fuse_in_parts(int views,
                           const std::function<DepthView<Device>(int)>& source,
                           TsdfVolume<Device>& volume,
                           const TsdfOptions& options,
                           float min_weight,
                           const std::string& spill_folder,
                           FusionReport& report) {
    struct Stored {
        Camera camera;
        SpillFile::Place depth, color, weight, keys;
    };
    SpillFile file(spill_folder);
    std::vector<Stored> stored;
    std::vector<std::uint64_t> all, merged, keys, touched;
    std::vector<float> depth, weight;
    std::vector<Vec3f> color;
    const auto to_file = [&](auto from, auto& values) {
        values = map_on_host(Device{}, from);
        return file.append(values.data(), values.size());
    };
    for (int i = 0; i < views; ++i) {
        const DepthView<Device> view = source(i);
        keys = with_context(str("fusing view ", i), [&] { return volume.touched_blocks(view); });
        stored.push_back({view.camera, to_file(view.depth, depth), to_file(view.color, color),
                          to_file(view.weight, weight), file.append(keys.data(), keys.size())});
        merged.clear();
        std::set_union(all.begin(), all.end(), keys.begin(), keys.end(),
                       std::back_inserter(merged));
        all.swap(merged);
    }

    PartPlanner planner(all, volume.part_capacity());
    MeshJoiner joiner(all);
    Buffer<float, Device> depth_buffer, weight_buffer;
    Buffer<Vec3f, Device> color_buffer;
    const auto load = [&](const Stored& view) -> DepthView<Device> {
        file.read(view.depth, depth), file.read(view.color, color), file.read(view.weight, weight);
        copy(depth, depth_buffer), copy(color, color_buffer), copy(weight, weight_buffer);
        return {view.camera, depth_buffer.span(), color_buffer.span(), weight_buffer.span()};
    };
    report.parts = 0;
    for (BlockPart part; planner.next(part); ++report.parts) {
        volume.start_part(part.keys);
        for (const Stored& view : stored) {
            file.read(view.keys, keys);
            touched.clear();
            std::set_intersection(keys.begin(), keys.end(), part.keys.begin(), part.keys.end(),
                                  std::back_inserter(touched));
            if (touched.empty() && !options.carve) continue;
            volume.integrate_into(load(view), options.carve ? part.keys : touched);
        }
        for (std::size_t i = 0; options.trust && i < stored.size(); ++i)
            volume.contradict(load(stored[i]));
        joiner.add(part, marching_cubes_part(volume.blocks(), min_weight, part.first, part.count));
    }
    report.blocks = static_cast<std::int64_t>(all.size());
    report.spilled_bytes = file.bytes();
    return joiner.finish();
}

}  // namespace detail

/// Fuses views 0 to `views` - 1 in this order; every options.max_bytes gives the same bytes.
/// `source(i)` renders view i, valid until the next call. If everything fits, it is called once per
/// view, once more to carve, and once more for trust. Else it is called again from view 0 on, once
/// per view, and an unnamed file in `spill_folder` takes 16 bytes per pixel of every view, 20 with
/// weights. Throws what TsdfVolume and PartPlanner throw.
template <class Device>
TriangleMesh fuse_views(int views,
                        const std::function<DepthView<Device>(int)>& source,
                        const TsdfOptions& options,
                        float min_weight,
                        const std::string& spill_folder,
                        FusionReport& report) {
    TsdfVolume<Device> volume(options);
    int fused = 0;
    const auto fits = [&] { return volume.integrate(source(fused)); };
    while (fused < views && with_context(str("fusing view ", fused), fits)) ++fused;
    report = {};
    TriangleMesh mesh;
    if (fused == views) {
        if (options.carve) {
            const std::vector<std::uint64_t> all = to_host(volume.blocks().keys);
            for (int i = 0; i < views; ++i) volume.integrate_into(source(i), all);
        }
        for (int i = 0; options.trust && i < views; ++i) volume.contradict(source(i));
        report.blocks = volume.blocks().size();
        mesh = marching_cubes(volume.blocks(), min_weight);
    } else {
        volume.clear();
        mesh =
            detail::fuse_in_parts(views, source, volume, options, min_weight, spill_folder, report);
    }
    report.bytes = report.blocks * VoxelBlocks<Device>::kBytesPerBlock;
    return mesh;
}

}  // namespace tvsgs
