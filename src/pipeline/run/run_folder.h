// Layout of a run folder, and checks of output paths.  docs/guide/commands.md
#pragma once

#include <cstdio>
#include <filesystem>
#include <initializer_list>
#include <optional>
#include <string>
#include <vector>

#include "core/scene/gaussians.h"
#include "core/scene/scene.h"
#include "io/config/config.h"
#include "io/files/json_value.h"
#include "io/scene/scene_reader.h"
#include "io/splats/ply.h"
#include "optim/loop/train.h"

namespace tvsgs {

/// Throws Error(ExitCode::usage) when `path` holds a run and neither `replace` nor `go_on` is set,
/// when another program's files there have names of a run's files, and when `path` is the scene,
/// lies among its photographs, or is the file system's root.
void require_free_run_folder(const std::string& path,
                             bool replace,
                             bool go_on,
                             const SceneOptions& scene);

/// Throws Error(ExitCode::usage) unless the file `out` may be written: its name ends in one of
/// `extensions`, it does not lie among the scene's photographs or masks, and it replaces only files
/// of ours. A stream (is_stream()) may have any name. Throws Error(ExitCode::io) where its folder
/// is not writable.
void require_output(const std::string& out,
                    std::initializer_list<const char*> extensions,
                    const SceneOptions& scene);

/// Whether `path` is `folder` or lies in it; follows links.
bool lies_in(const std::filesystem::path& path, const std::filesystem::path& folder);

/// A lock on a folder for this process while it lives, against a second process of the same kind.
class FolderLock {
public:
    /// held() is true if another process has the lock.
    explicit FolderLock(const std::string& folder);
    FolderLock(const FolderLock&) = delete;
    FolderLock& operator=(const FolderLock&) = delete;
    ~FolderLock();
    bool held() const { return held_; }
    /// Where the folder is now; empty: it was removed.
    std::string place() const;

private:
    int lock_ = -1;
    bool held_ = false;
};

/// Makes a folder and locks it while the scene is read, so that other processes see that a run
/// begins there. Removes the folders that it made, if they are empty at the end.
class FolderClaim {
public:
    explicit FolderClaim(const std::string& path);
    FolderClaim(const FolderClaim&) = delete;
    FolderClaim& operator=(const FolderClaim&) = delete;
    ~FolderClaim();

private:
    std::vector<std::string> made_;  // innermost first
    std::optional<FolderLock> lock_;
};

/// Throws Error(ExitCode::io) if the disk of this folder has less free space.
void require_disk(const std::string& path, std::int64_t bytes);

class RunFolder {
public:
    /// Creates the folder and its log, replacing an earlier run. With `done` >= 0 it continues the
    /// run there after iteration `done`, and drops later lines of the log. Throws
    /// Error(ExitCode::io) when it cannot be written, Error(ExitCode::usage) when another process
    /// writes there.
    explicit RunFolder(const std::string& path, int done = -1);
    ~RunFolder();

    const std::string& path() const { return path_; }
    /// Updates path() if somebody has moved the folder, and returns whether that is so. Throws
    /// Error(ExitCode::io) if it was removed.
    bool follow();
    void save_config(const std::string& json) const;

    /// Writes cameras.json in the layout of 3DGS: training views first, then test views.
    void save_cameras(const Scene& scene) const;

    /// Appends one line to log.jsonl and flushes it.
    void log(const JsonValue& line);

    /// Writes point_cloud/iteration_N/point_cloud.ply. `origin`: of the scene, as in
    /// io/splats/ply.h.
    void save_splats(const Gaussians<Cpu>& gaussians,
                     int iteration,
                     Vec3d origin,
                     PlyScales scales) const;

    /// Removes the splats saved where the run was stopped, as listed in its log; keeps those of
    /// iteration `last`.
    void remove_splats_of_stops(int last) const;

private:
    std::string path_;
    std::optional<FolderLock> lock_;
    std::FILE* log_ = nullptr;
};

bool holds_splats(const std::string& run);

/// The file with the splats of the largest iteration in a run folder; returns `path` if it is a
/// file. Throws Error(ExitCode::input).
std::string find_splats(const std::string& path);

/// Sets `backbone` for discs if a PLY has two scales and nobody has set the key. Throws
/// Error(ExitCode::input) if the key is set to a backbone for ellipsoids.
void choose_backbone(const std::string& file, const BackboneOptions& render, OptionTable& table);

/// Reads the splats (at least one) of a file for the backbone of `train`. Throws
/// Error(ExitCode::input), also where the file has discs and the backbone draws ellipsoids, or the
/// reverse.
Gaussians<Cpu> read_splats(const std::string& file, Vec3d origin, const TrainOptions& train);

/// The newest mesh of a run folder: mesh.glb, .ply or .obj in mesh/ or in the run folder itself (an
/// --out may point there); empty: none.
std::string find_mesh(const std::string& path);

/// Path of a run's config.json. Throws Error(ExitCode::input) when `path` is no run folder.
std::string run_config_path(const std::string& path);

/// Reads the scene that `options` of the run `path` name, with the cameras that the run refined.
/// Throws Error(ExitCode::input), also where most views with a name of the run are more than 0.05
/// extents away from their position in its cameras.json; the message says how to name another
/// scene. Warns where no names match.
Scene read_scene_of_run(const SceneOptions& options, const std::string& path);

}  // namespace tvsgs
