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

/// Fixed bytes, and bytes per splat.
struct MemoryNeed {
    std::int64_t fixed = 0, per_splat = 0;

    std::int64_t at(std::int64_t splats) const { return fixed + per_splat * splats; }
};

/// Bytes that the training may use. On a CPU both limits are the host's.
struct MemoryLimits {
    std::int64_t device = 0, host = 0;
};
/// Throws Error(ExitCode::usage) for a limit that is not a size.
MemoryLimits memory_limits(const MemoryOptions& memory, bool cuda);

/// Measured peaks of trainings are between half of this estimate and all of it.
struct MemoryPlan {
    MemoryNeed buffers;  // all Buffers on the training device
    MemoryNeed host;     // all memory on the host; on a CPU it includes `buffers`
    MemoryLimits limits;
    std::int64_t first = 0;  // splats at the start
    std::int64_t most = 0;   // growth stops at this number of splats
    bool grows = false;
    bool cuda = false;

    /// "63 MB of 21.1 GB for 4,385 splats", for people.
    std::string text() const;
    /// Bytes for the first splats, of the device that trains.
    std::int64_t first_bytes() const { return (cuda ? buffers : host).at(first); }
    /// Text of RUN/memory.json.
    std::string json() const;
};

/// Share of the first splats that the training view with most of them sees, plus room for splats
/// that reach into its image and for growth there; 1 without points.
double share_in_view(const Scene& scene);

/// Bytes per splat that one render keeps for its backward pass.
std::int64_t view_bytes_per_splat(double share_in_view);

/// Bytes of the files of a training without growth: splats, and the checkpoints that exist at one
/// time.
std::int64_t disk_bytes(std::int64_t splats, int sh_degree, int checkpoints);

/// Number of splats that fit into `limits`.
std::int64_t fitting(const MemoryPlan& needs, const MemoryLimits& limits);

/// Whether the number of splats may rise.
bool grows(const TrainOptions& options);

/// Number of splats at which the options stop growth, without regard to memory.
std::int64_t growth_cap(const Scene& scene, const DensifyOptions& options);

/// Whether photographs and maps would fill over half of `device_limit`; then they stay on the host.
bool photos_crowd(const Scene& scene, const TrainOptions& options, std::int64_t device_limit);

/// Returns options.photo_bytes; if it is 0, returns 1 on a CPU with the photographs in a file.
std::int64_t photo_budget(const Scene& scene, const TrainOptions& options, bool cuda);

/// Number of blocks that hold `splats`, if a block has room for `fitting` splats with its margin.
std::int64_t blocks_for(std::int64_t splats, std::int64_t fitting);
/// The command that makes these blocks.
std::string split_command(const std::string& scene, std::int64_t blocks);

/// Estimates the memory of a training that starts with `splats` splats.
MemoryPlan estimate_memory(const Scene& scene,
                           const TrainOptions& options,
                           std::int64_t splats,
                           bool cuda);

/// Estimates the memory; lowers options.densify.max_gaussians to growth_cap() and to the number of
/// splats that fit into memory_limits(); sets options.photo_bytes and the limits of the allocators.
/// Throws Error(ExitCode::memory) if the first splats do not fit.
MemoryPlan plan_memory(const Scene& scene,
                       const MemoryOptions& memory,
                       std::int64_t splats,
                       bool cuda,
                       TrainOptions& options);

}  // namespace tvsgs
