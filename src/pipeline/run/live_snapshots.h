// Writes snapshots of a running training to RUN/live/, for viewers.
#pragma once

#include <future>
#include <string>

#include "core/progress.h"
#include "core/scene/gaussians.h"

namespace tvsgs {

/// Writes splats.spz (in our frame, base colours only) and then state.json: {"iteration",
/// "iterations", "seconds", "gaussians", "origin"}. Replaces files atomically. Writes on its own
/// thread, so the training only waits for a copy of the splats. A failed write warns once and ends
/// the snapshots.
class LiveSnapshots {
public:
    /// `every`: smallest number of seconds between snapshots; 0: none. `origin`: of the scene.
    /// Removes files that a killed training left in the folder.
    LiveSnapshots(std::string run, Vec3d origin, double every)
        : run_(std::move(run)), origin_(origin), every_(every) {
        remove_files();
    }
    ~LiveSnapshots() { finish(); }

    /// Whether it is time for a snapshot and the last one is written.
    bool due();
    void write(int iteration, int iterations, double seconds, Gaussians<Cpu>&& splats);

    void set_run(std::string run) { run_ = std::move(run); }

    /// Waits and removes the files: viewers then show the results.
    void finish();

private:
    void remove_files() const;

    std::string run_;
    Vec3d origin_;
    double every_;
    double last_ = steady_seconds();
    std::future<void> writing_;
    bool written_ = false;  // there are files to remove
};

}  // namespace tvsgs
