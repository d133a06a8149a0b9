// The folder of a run: its layout in one place.  docs/commands.md
#pragma once

#include <cstdio>
#include <string>

#include "core/gaussians.h"
#include "core/scene.h"

namespace tvsgs {

/// Throws Error(ExitCode::usage) when `path` holds a run and is not to be overwritten.
void require_free_run_folder(const std::string& path, bool overwrite);

class RunFolder {
public:
    /// Creates the folder and its log. A folder that holds another run is refused unless
    /// `overwrite`. Throws Error(ExitCode::io) when it cannot be written, before any work is done.
    RunFolder(const std::string& path, bool overwrite);
    RunFolder(const RunFolder&) = delete;
    RunFolder& operator=(const RunFolder&) = delete;
    ~RunFolder();

    const std::string& path() const { return path_; }
    void save_config(const std::string& json) const;

    /// cameras.json in the layout of 3DGS: training views first, then test views.
    void save_cameras(const Scene& scene) const;

    /// Appends one line to log.jsonl and flushes it.
    void log(const std::string& json_line);

    /// point_cloud/iteration_N/point_cloud.ply
    void save_splats(const Gaussians<Cpu>& gaussians, int iteration) const;

private:
    std::string path_;
    std::FILE* log_ = nullptr;
};

/// The splats of the largest iteration in a run folder, or `path` itself when it is a file. Throws
/// Error(ExitCode::input).
std::string find_splats(const std::string& path);

/// config.json of a run folder. Throws Error(ExitCode::input) when `path` is no run folder.
std::string run_config_path(const std::string& path);

}  // namespace tvsgs
