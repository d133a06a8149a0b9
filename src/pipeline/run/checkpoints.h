// RUN/checkpoints/: what a run saves of itself, and how it goes on from there.
#pragma once

#include <future>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/scene/scene.h"
#include "io/config/config.h"
#include "optim/loop/train.h"

namespace tvsgs {

/// A checkpoint, read.
struct ResumePoint {
    std::string file;
    std::string run;  // folder of the run it lies in; empty: it was given by itself
    SharedState state;
    int done = 0;        // iterations
    double seconds = 0;  // of training
    std::string config;  // resolved, as JSON
};

/// `place`: a run folder, whose newest good checkpoint is taken, or a checkpoint. Nothing when the
/// folder has none. Throws Error(ExitCode::input) when there are some but none is good.
std::optional<ResumePoint> open_checkpoint(const std::string& place);

/// Gives the scene the initial points and the extent of the checkpoint's. Throws
/// Error(ExitCode::input) when its training views are others; warns when its photographs are.
void adopt_scene(const ResumePoint& point, Scene& scene);

/// Checksums of a scene: names and poses of its training views, which keep them at any resolution;
/// their photographs; its initial points.
std::uint32_t views_id(const Scene& scene);
std::uint32_t photos_id(const Scene& scene);
std::uint32_t points_id(const Scene& scene);

/// Removes the run's checkpoints of more than `done` iterations, which open_checkpoint() would take
/// for the newest.
void remove_checkpoints_after(const std::string& run, int done);

/// Key and value of every option, in the table's order.
std::vector<std::pair<std::string, std::string>> config_values(const OptionTable& table);
/// The keys whose value differs from `before`, which is config_values() of an earlier moment, as a
/// JSON object {"key": "before -> now"}.
JsonValue changed_values(const std::vector<std::pair<std::string, std::string>>& before,
                         const OptionTable& table);

/// Writes checkpoints in the background and keeps the newest two of a run. A checkpoint that cannot
/// be written is a warning: the older ones stay, and the training goes on.
class CheckpointWriter {
public:
    /// `scene` must outlive it.
    CheckpointWriter(std::string run, std::string config, const Scene& scene)
        : run_(std::move(run)), config_(std::move(config)), scene_(scene) {}
    CheckpointWriter(const CheckpointWriter&) = delete;
    CheckpointWriter& operator=(const CheckpointWriter&) = delete;
    ~CheckpointWriter() { finish(); }

    void save(int done, double seconds, const SharedState& state);

    /// `config`: stored in the checkpoints from here on.
    void set_config(std::string config) { config_ = std::move(config); }

    /// Waits for the last one; its file, or nothing when it could not be written.
    std::optional<std::string> finish();

    /// Why the last one could not be written.
    const std::string& failure() const { return failure_; }

private:
    std::string run_, config_;
    const Scene& scene_;
    std::optional<std::uint32_t> photos_;
    std::string file_, failure_;
    std::future<std::string> writing_;  // the failure
};

}  // namespace tvsgs
