// RUN/live/: a training on its way, for whoever looks on.
#pragma once

#include <chrono>
#include <future>
#include <string>

#include "core/scene/gaussians.h"

namespace tvsgs {

/// Writes splats.spz (in our frame, without harmonics) and then state.json: {"iteration",
/// "iterations", "seconds", "gaussians", "origin"}. Files appear whole. On a thread of its own, so
/// the training waits for a copy of the splats only. What cannot be written is one warning, and the
/// end of the snapshots.
class LiveSnapshots {
public:
    /// `every`: seconds between two, at least; 0: none. `origin`: the scene's.
    /// Removes what a training that was killed has left: the run is this one's.
    LiveSnapshots(std::string run, Vec3d origin, double every)
        : run_(std::move(run)), origin_(origin), every_(every) {
        remove_files();
    }
    LiveSnapshots(const LiveSnapshots&) = delete;
    LiveSnapshots& operator=(const LiveSnapshots&) = delete;
    ~LiveSnapshots() { finish(); }

    /// Time for one, and the last one is written.
    bool due();
    void write(int iteration, int iterations, double seconds, Gaussians<Cpu>&& splats);

    /// Waits, and removes the files: whoever looks on then sees the results.
    void finish();

private:
    void remove_files() const;

    using Clock = std::chrono::steady_clock;

    std::string run_;
    Vec3d origin_;
    double every_;
    Clock::time_point last_ = Clock::now();
    std::future<void> writing_;
    bool written_ = false;  // there is something to remove
};

}  // namespace tvsgs
