// How much memory a training will take, before its first step, and how far it may grow.
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

/// Bytes that go with the number of splats, and those that do not.
struct MemoryNeed {
    std::int64_t fixed = 0, per_splat = 0;

    std::int64_t at(std::int64_t splats) const { return fixed + per_splat * splats; }
};

/// Bytes that may be used; with the CPU as the device both are the host's.
struct MemoryLimits {
    std::int64_t device = 0, host = 0;
};
/// What `memory` says, else most of what is free. Throws Error(ExitCode::usage) for limits that are
/// none.
MemoryLimits memory_limits(const MemoryOptions& memory, bool cuda);

/// An estimate: measured peaks of trainings lie between half of it and all of it
/// (tests/reliability).
struct MemoryPlan {
    MemoryNeed buffers;  // of all Buffers on the training device
    MemoryNeed host;     // of all on the host; with the CPU as the device, `buffers` are a part
    MemoryLimits limits;
    std::int64_t first = 0;  // splats at the start
    std::int64_t most = 0;   // splats that growth stops at

    /// One line for people.
    std::string text() const;
    /// RUN/memory.json
    std::string json() const;
};

/// Of the first splats, in the training view that has most of them; all where nothing is known.
/// With room for splats that reach in from beside the image, and for growth to be where this view
/// is.
double share_in_view(const Scene& scene);

/// Of what one render keeps for its way back, where a share of the splats is in view.
std::int64_t view_bytes_per_splat(double share_in_view);

/// How many splats fit into `limits`; INT64_MAX where they take nothing.
std::int64_t fitting(const MemoryPlan& needs, const MemoryLimits& limits);

/// Whether the number of splats may rise.
bool grows(const TrainOptions& options);

/// Where growth stops by the options, whatever the memory.
std::int64_t growth_cap(const Scene& scene, const DensifyOptions& options);

/// Whether photographs and maps take so much of the device that they are to stay on the host, where
/// options.photo_bytes does not say it.
bool photos_crowd(const Scene& scene, const TrainOptions& options, std::int64_t device_limit);

/// options.photo_bytes, or, on a CPU, what it is to be where the photographs are in a file.
std::int64_t photo_budget(const Scene& scene, const TrainOptions& options, bool cuda);

/// Blocks that `splats` make where one holds `fitting` of them, its margin included.
std::int64_t blocks_for(std::int64_t splats, std::int64_t fitting);
/// What to type for it.
std::string split_command(const std::string& scene, std::int64_t blocks);

/// The needs for `splats` at the start.
MemoryPlan estimate_memory(const Scene& scene,
                           const TrainOptions& options,
                           std::int64_t splats,
                           bool cuda);

/// With limits from `memory`, else from what is free; lowers options.densify.max_gaussians to what
/// fits, and to options.densify.max_per_pixel, and makes the limits those of the allocators. Throws
/// Error(ExitCode::memory) when the first splats do not fit, Error(ExitCode::usage) for limits that
/// are none.
MemoryPlan plan_memory(const Scene& scene,
                       const MemoryOptions& memory,
                       std::int64_t splats,
                       bool cuda,
                       TrainOptions& options);

}  // namespace tvsgs
