// Estimates the memory of a training before its first step, and how far it may grow.
#pragma once

#include <cstdint>
#include <string>

#include "core/scene/scene.h"
#include "optim/loop/train.h"

namespace tvsgs {

struct MemoryOptions {
    std::string gpu, host;

    template <class Visitor>
    void fields(Visitor& field) {
        field("gpu", gpu,
              "GPU memory for training, such as 8G or 500M; empty: 90 % of the free memory");
        field("host", host,
              "host memory for training, such as 8G or 500M; empty: 90 % of the free memory");
    }
};

/// Bytes: fixed ones, and those of each splat.
struct MemoryNeed {
    std::int64_t fixed = 0, per_splat = 0;

    std::int64_t at(std::int64_t splats) const { return fixed + per_splat * splats; }
};

/// Bytes that the training may use. On a CPU both are the host's.
struct MemoryLimits {
    std::int64_t device = 0, host = 0;
};
/// Throws Error(ExitCode::usage) for a limit that is not a size.
MemoryLimits memory_limits(const MemoryOptions& memory, bool cuda);

/// Measured peaks of trainings are between half of this estimate and all of it.
struct MemoryPlan {
    MemoryNeed buffers;  // all Buffers on the training device
    MemoryNeed host;     // all on the host; on a CPU with `buffers`
    MemoryLimits limits;
    std::int64_t first = 0;  // splats at the start
    std::int64_t most = 0;   // growth stops at this number of splats
    bool grows = false;
    bool cuda = false;

    /// "63 MB of 21.1 GB for 4,385 splats", for people.
    std::string text() const;
    /// Bytes for the first splats, of the device that trains.
    std::int64_t first_bytes() const { return (cuda ? buffers : host).at(first); }
    /// RUN/memory.json
    std::string json() const;
};

/// Share of the first splats in the training view that has most of them, with room for splats that
/// reach into the image and for growth in this view; 1 without points.
double share_in_view(const Scene& scene);

/// Bytes per splat that one render keeps for its backward pass.
std::int64_t view_bytes_per_splat(double share_in_view);

/// How many splats fit into `limits`.
std::int64_t fitting(const MemoryPlan& needs, const MemoryLimits& limits);

/// Whether the number of splats may rise.
bool grows(const TrainOptions& options);

/// Number of splats at which the options stop growth, without regard to memory.
std::int64_t growth_cap(const Scene& scene, const DensifyOptions& options);

/// Whether photographs and maps fill more than half of the device, and so stay on the host.
bool photos_crowd(const Scene& scene, const TrainOptions& options, std::int64_t device_limit);

/// options.photo_bytes; 1 on a CPU if the photographs are in a file and the options set no size.
std::int64_t photo_budget(const Scene& scene, const TrainOptions& options, bool cuda);

/// Number of blocks for `splats`, if one holds `fitting` of them with its margin.
std::int64_t blocks_for(std::int64_t splats, std::int64_t fitting);
/// The command that makes these blocks.
std::string split_command(const std::string& scene, std::int64_t blocks);

/// The needs for `splats` at the start.
MemoryPlan estimate_memory(const Scene& scene,
                           const TrainOptions& options,
                           std::int64_t splats,
                           bool cuda);

/// Estimates within memory_limits(), lowers options.densify.max_gaussians to the limit of growth
/// and the number that fits, and sets the limits of the allocators. Throws Error(ExitCode::memory)
/// if the first splats do not fit.
MemoryPlan plan_memory(const Scene& scene,
                       const MemoryOptions& memory,
                       std::int64_t splats,
                       bool cuda,
                       TrainOptions& options);

}  // namespace tvsgs
