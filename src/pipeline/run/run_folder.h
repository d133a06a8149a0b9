// The folder of a run: its layout in one place.  docs/guide/commands.md
#pragma once

#include <cstdio>
#include <filesystem>
#include <initializer_list>
#include <string>

#include "core/scene/gaussians.h"
#include "core/scene/scene.h"
#include "io/files/json_value.h"
#include "io/scene/scene_reader.h"
#include "io/splats/ply.h"
#include "optim/loop/train.h"

namespace tvsgs {

/// Throws Error(ExitCode::usage) when `path` holds a run that is neither to be replaced nor to go
/// on, another program's files of names that a run has, or is the scene, lies among its
/// photographs, or is the root of all folders.
void require_free_run_folder(const std::string& path,
                             bool replace,
                             bool go_on,
                             const SceneOptions& scene);

/// Throws Error(ExitCode::usage) unless a file called `out` may be written: it ends in one of
/// `extensions`, whose format it gets (`why`), does not lie among the photographs or masks of the
/// scene, and replaces nothing but a file of ours. A stream (is_stream()) may have any name. Throws
/// Error(ExitCode::io) where its folder cannot be written to.
void require_output(const std::string& out,
                    std::initializer_list<const char*> extensions,
                    const std::string& why,
                    const SceneOptions& scene);

/// Whether `path` is `folder` or lies in it, links followed.
bool lies_in(const std::filesystem::path& path, const std::filesystem::path& folder);

class RunFolder {
public:
    /// Creates the folder, in place of an earlier run there, and its log; or, with `done` of at
    /// least 0, goes on with the run there after that many iterations: lines of the log beyond them
    /// are dropped. Throws Error(ExitCode::io) when it cannot be written, Error(ExitCode::usage)
    /// when another process writes there.
    explicit RunFolder(const std::string& path, int done = -1);
    RunFolder(const RunFolder&) = delete;
    RunFolder& operator=(const RunFolder&) = delete;
    ~RunFolder();

    const std::string& path() const { return path_; }
    void save_config(const std::string& json) const;

    /// cameras.json in the layout of 3DGS: training views first, then test views.
    void save_cameras(const Scene& scene) const;

    /// Appends one line to log.jsonl and flushes it.
    void log(const JsonValue& line);

    /// point_cloud/iteration_N/point_cloud.ply; `origin`: the scene's, as in all of
    /// io/splats/ply.h.
    void save_splats(const Gaussians<Cpu>& gaussians,
                     int iteration,
                     Vec3d origin,
                     PlyScales scales) const;

    /// Removes the splats of where the run was stopped on its way, as its log has it; not those of
    /// `last`.
    void remove_splats_of_stops(int last) const;

private:
    std::string path_;
    int lock_ = -1;  // held by the process that writes there
    std::FILE* log_ = nullptr;
};

/// Whether a run folder holds splats.
bool holds_splats(const std::string& run);

/// The file with the splats of the largest iteration in a run folder, or `path` itself when it is a
/// file. Throws Error(ExitCode::input).
std::string find_splats(const std::string& path);

/// The splats in that file, at least one, as the backbone of `train` draws them. Throws
/// Error(ExitCode::input), also where they are discs and it draws ellipsoids, or the other way
/// round.
Gaussians<Cpu> read_splats(const std::string& file, Vec3d origin, const TrainOptions& train);

/// The mesh of a run folder: mesh.glb, .ply or .obj in its folder mesh/ or in itself, where an
/// --out may have put it, the latest that was written; empty: none.
std::string find_mesh(const std::string& path);

/// config.json of a run folder. Throws Error(ExitCode::input) when `path` is no run folder.
std::string run_config_path(const std::string& path);

/// Throws Error(ExitCode::input) where most views of the run's names stand elsewhere than its
/// cameras.json has them, by 0.05 extents; warns where no name is the same.
void require_scene_of_run(const std::string& run, const Scene& scene);

/// The scene that `options` of the run `path` name, with the cameras that the run refined; when
/// that fails, or as require_scene_of_run(), the message says how to name another.
Scene read_scene_of_run(const SceneOptions& options, const std::string& path);

}  // namespace tvsgs
