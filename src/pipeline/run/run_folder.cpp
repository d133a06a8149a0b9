#include "pipeline/run/run_folder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstring>
#include <map>
#include <thread>
#include <vector>

#include "core/error.h"
#include "core/log.h"
#include "io/files/atomic_file.h"
#include "io/files/manifest.h"
#include "io/files/read_file.h"
#include "pipeline/run/refined_cameras.h"
#include "plan/decide.h"
#include "plan/figures.h"
#include "plan/settings.h"

namespace tvsgs {
namespace fs = std::filesystem;
namespace {

constexpr std::string_view kEntries[] = {"config.json",
                                         "exposure.json",
                                         "sky.png",
                                         "plan.json",
                                         "memory.json",
                                         "log.jsonl",
                                         "cameras.json",
                                         "cameras",
                                         "point_cloud",
                                         "checkpoints",
                                         "mesh",
                                         "eval",
                                         "test",
                                         "live",
                                         "report.json",
                                         "report.html",
                                         "georeference.json"};

/// Whether there is a file with contents, there or below. (A run killed before it has a
/// configuration leaves an empty log.)
bool has_contents(const fs::path& path) {
    std::error_code code;
    if (fs::is_regular_file(path, code)) return !fs::is_empty(path, code);
    for (fs::recursive_directory_iterator it(path, code), end; !code && it != end;
         it.increment(code))
        if (it->is_regular_file(code)) return true;
    return false;
}

void require_outside_of_pictures(const std::string& out, const SceneOptions& scene) {
    for (const std::string& name : {scene.images, scene.masks, std::string("images"),
                                    std::string("mask"), std::string("masks")})
        if (!name.empty() && lies_in(out, fs::path(scene.path) / name))
            throw Error(ExitCode::usage, "--out ", out,
                        ": lies inside the photographs of the scene, ",
                        (fs::path(scene.path) / name).string(), "; choose another folder");
}

/// Removes half-written files of a killed process; keeps other files.
void remove_leftovers(const fs::path& folder) {
    std::error_code code;
    std::vector<fs::path> found;
    for (fs::recursive_directory_iterator it(folder, code), end; !code && it != end;
         it.increment(code)) {
        const std::string name = it->path().filename().string();
        const std::size_t mark = name.find(".tmp-");
        const std::string_view entry = std::string_view(name).substr(0, mark);
        if (it.depth() == 0 && std::ranges::find(kEntries, entry) == std::end(kEntries))
            it.disable_recursion_pending();
        else if (mark != std::string::npos)
            found.push_back(it->path());
    }
    for (const fs::path& file : found) fs::remove(file, code);
}

/// Iteration of a line of the log; 0: it has none.
int iteration_of(std::string_view line) {
    constexpr std::string_view key = "\"iteration\": ";
    const std::size_t at = line.find(key);
    int iteration = 0;
    if (at != std::string_view::npos)
        std::from_chars(line.data() + at + key.size(), line.data() + line.size(), iteration);
    return iteration;
}

/// The lines of a log up to an iteration; drops a truncated line.
std::string log_up_to(const fs::path& log, int done) {
    std::error_code code;
    if (!fs::is_regular_file(log, code)) return {};
    const std::string all = read_bytes(log.string());
    std::string kept;
    for (std::size_t begin = 0, end; (end = all.find('\n', begin)) != std::string::npos;
         begin = end + 1) {
        const std::string_view line(all.data() + begin, end - begin);
        if (iteration_of(line) <= done && line.ends_with('}')) kept += std::string(line) + "\n";
    }
    return kept;
}

/// The largest iteration with splats in a run folder; -1: none.
int newest_splats(const std::string& run) {
    std::error_code code;
    const fs::path folder = fs::path(run) / "point_cloud";
    int best = -1;
    for (fs::directory_iterator it(folder, code), end; !code && it != end; it.increment(code)) {
        const std::string name = it->path().filename().string(), prefix = "iteration_";
        int iteration = -1;
        if (name.starts_with(prefix))
            std::from_chars(name.data() + prefix.size(), name.data() + name.size(), iteration);
        if (iteration > best && fs::exists(it->path() / "point_cloud.ply", code)) best = iteration;
    }
    return best;
}

/// Whether a file with three scales holds discs: nearly all are a hundredth as thick as wide.
bool are_thin(const Gaussians<Cpu>& splats) {
    int thin = 0;
    for (const Vec3f l : splats.log_scales.span())
        thin += l.z < std::min(l.x, l.y) + std::log(0.01f);
    return thin > 0.99 * splats.size();
}

void require_disc_backbone(const std::string& file,
                           const std::string& backbone,
                           const BackboneOptions& render) {
    if (make_backbone<Cpu>(backbone, render)->traits.flat) return;
    throw input_error("E_PLY_SCALES: ", file, ": discs (splats with two scales), but backbone '",
                      backbone, "' draws ellipsoids; remove this key, or set one for discs (",
                      backbones_of(true), ")");
}

/// See read_scene_of_run().
void require_scene_of_run(const std::string& run, const Scene& scene) {
    const std::string file = run + "/cameras.json";
    std::error_code code;
    if (!fs::is_regular_file(file, code)) return;
    std::map<std::string, Vec3d> centres;
    const JsonValue cameras = parse_json_value(read_bytes(file), file);
    for (const JsonValue& camera : cameras.items)
        if (const std::vector<JsonValue>& at = camera["position"].items; at.size() == 3)
            centres[camera["img_name"].text_or("")] = {at[0].number, at[1].number, at[2].number};
    // Refined poses differ a little from the scene's, and float rounds.
    const double shift = 0.05 * double(scene.extent);
    constexpr double kRounding = 1e-5;
    std::ptrdiff_t same = 0, elsewhere = 0;
    for (const std::vector<View>* views : {&scene.train, &scene.test})
        for (const View& view : *views)
            if (const auto found = centres.find(view.name); found != centres.end()) {
                const Vec3d here = vec_cast<double>(camera_centre(view.camera)) + scene.origin;
                const double off = norm(here - found->second);
                ++same, elsewhere += !(off <= shift + kRounding * norm(here));
            }
    if (same == 0) {
        if (!centres.empty())
            spdlog::warn("{}: shares no views with the training of {}; assumes the same frame",
                         scene.path, run);
        return;
    }
    if (2 * elsewhere > same)
        throw input_error(scene.path, ": not the scene of ", run, ": ", elsewhere, " of ", same,
                          " views have other poses than in its cameras.json; give the scene of the "
                          "training, in the same frame");
}

[[noreturn]] void refuse_used_folder(const std::string& path) {
    throw Error(ExitCode::usage, path,
                ": another tvsgs-train writes there; wait for it, or choose another folder with "
                "--out");
}

}  // namespace

bool lies_in(const fs::path& path, const fs::path& folder) {
    std::error_code code;
    if (!fs::is_directory(folder, code)) return false;
    const fs::path whole = fs::weakly_canonical(fs::absolute(path), code),
                   outer = fs::canonical(folder, code);
    if (code) return false;
    return std::mismatch(outer.begin(), outer.end(), whole.begin(), whole.end()).first ==
           outer.end();
}

void require_output(const std::string& out,
                    std::initializer_list<const char*> extensions,
                    const SceneOptions& scene) {
    if (is_stream(out)) return;
    const std::string found = lower_case(fs::path(out).extension().string());
    if (std::ranges::find(extensions, found) == extensions.end()) {
        std::string expected;
        for (auto e = extensions.begin(); e != extensions.end(); ++e)
            expected += str(e == extensions.begin()     ? ""
                            : e + 1 == extensions.end() ? " or "
                                                        : ", ",
                            *e);
        throw Error(ExitCode::usage, out, ": ",
                    found.empty() ? "no ending" : str("unknown ending ", found), "; use ",
                    expected);
    }
    require_outside_of_pictures(out, scene);
    require_replaceable(out);
    require_not_results_file(out);
    // Check now: these errors would otherwise appear after all the work.
    std::error_code code;
    fs::path folder = fs::absolute(out, code).lexically_normal().parent_path();
    while (!fs::exists(folder, code) && folder != folder.parent_path())
        folder = folder.parent_path();
    if (!fs::is_directory(folder, code))
        throw Error(ExitCode::io, "--out ", out, ": ", folder.string(), " is not a folder");
    if (::access(folder.c_str(), W_OK) != 0)
        throw Error(ExitCode::io, "--out ", out, ": cannot write in ", folder.string(), ": ",
                    std::strerror(errno));
}

void require_free_run_folder(const std::string& path,
                             bool replace,
                             bool go_on,
                             const SceneOptions& scene) {
    std::error_code code;
    if (fs::equivalent(path, scene.path, code))
        throw Error(ExitCode::usage, path, ": this is the scene; choose another folder with --out");
    if (fs::equivalent(path, "/", code))
        throw Error(ExitCode::usage, path,
                    ": this is the root folder; choose another one with --out");
    require_outside_of_pictures(path, scene);
    const std::string config = (fs::path(path) / "config.json").string();
    if (!fs::exists(config, code)) {
        if (has_manifest(path) && holds_listed_files(path))
            throw Error(ExitCode::usage, path,
                        ": holds other results, such as a scene of "
                        "tvsgs-synth; choose another folder with --out");
        for (const std::string_view entry : kEntries)
            if (has_contents(fs::path(path) / entry))
                throw Error(
                    ExitCode::usage, path, ": not a run folder (no config.json), but it has ",
                    entry, ", which a run would replace; choose an empty or new folder with --out");
        return;
    }
    if (FolderLock(path).held()) refuse_used_folder(path);
    if (!replace && !go_on)
        throw Error(ExitCode::usage, path,
                    ": holds another run; choose a new folder with --out, or "
                    "replace the run with --overwrite");
    // Overwriting removes files: never those of another program.
    if (read_bytes(config).find("\"version\": \"tvsgs") == std::string::npos)
        throw Error(ExitCode::usage, config,
                    ": tvsgs-train did not write it, so the folder is not "
                    "overwritten; choose another with --out");
    if (!has_manifest(path))
        throw Error(ExitCode::usage, path,
                    ": no list of our files (.tvsgs-files), so yours could be lost; copy the "
                    "run with that list, or choose another folder with --out");
}

FolderLock::FolderLock(const std::string& folder)
    : lock_(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
    const auto is_taken = [this] {
        return lock_ >= 0 && flock(lock_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
    };
    // Another process may only be testing the lock.
    for (int attempt = 0; (held_ = is_taken()) && attempt < 3; ++attempt)
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
}

std::string FolderLock::place() const {
    std::error_code code;
    const fs::path place = fs::read_symlink(str("/proc/self/fd/", lock_), code);
    struct stat here, there;
    return !code && fstat(lock_, &here) == 0 && stat(place.c_str(), &there) == 0 &&
                   here.st_ino == there.st_ino
               ? place.string()
               : "";
}

FolderLock::~FolderLock() {
    if (lock_ >= 0) close(lock_);
}

FolderClaim::FolderClaim(const std::string& path) {
    std::error_code code;
    for (fs::path folder = fs::absolute(path, code).lexically_normal();
         !folder.empty() && !fs::exists(folder, code) && folder != folder.parent_path();
         folder = folder.parent_path())
        made_.push_back(folder.string());
    fs::create_directories(path, code);  // RunFolder reports a failure
    lock_.emplace(path);
}

FolderClaim::~FolderClaim() {
    std::error_code code;
    for (const std::string& folder : made_)
        if (fs::is_empty(folder, code)) fs::remove(folder, code);
}

void require_disk(const std::string& path, std::int64_t bytes) {
    std::error_code code;
    const fs::space_info space = fs::space(path, code);
    if (!code && space.available < std::uintmax_t(bytes))
        throw Error(ExitCode::io, path, ": the disk has ", bytes_text(double(space.available)),
                    " free, and splats and checkpoints need ", bytes_text(double(bytes)),
                    "; free space, or choose another folder with --out");
}

RunFolder::RunFolder(const std::string& path, int done) : path_(path) {
    const fs::path folder(path);
    std::error_code code;
    fs::create_directories(folder, code);
    if (lock_.emplace(path).held()) refuse_used_folder(path);
    const bool go_on = done >= 0;
    if (!code) remove_leftovers(folder);
    if (!code && go_on) {
        write_text_file(folder / "log.jsonl", log_up_to(folder / "log.jsonl", done));
    } else if (!code) {
        if (has_manifest(folder)) remove_listed_files(folder);
        start_manifest(folder);
    }
    if (!code) add_to_manifest(folder, folder / "log.jsonl");
    if (!code) log_ = std::fopen((folder / "log.jsonl").c_str(), go_on ? "a" : "w");
    if (log_ == nullptr)
        throw Error(ExitCode::io, path,
                    ": cannot write there: ", code ? code.message() : std::strerror(errno),
                    "; choose another folder with --out");
}

RunFolder::~RunFolder() {
    if (log_ != nullptr) std::fclose(log_);
}

bool RunFolder::follow() {
    std::error_code code;
    const std::string place = lock_->place();
    if (place.empty())
        throw Error(ExitCode::io, path_, ": was removed during the training; start it again");
    if (fs::equivalent(place, path_, code)) return false;
    path_ = place;
    return true;
}

void RunFolder::save_config(const std::string& json) const {
    write_text_file(path_ + "/config.json", json + "\n");
}

void RunFolder::save_cameras(const Scene& scene) const {
    std::string text = "[";
    int id = 0;
    for (const std::vector<View>* views : {&scene.train, &scene.test})
        for (const View& view : *views) {
            const Camera& c = view.camera;
            const Vec3d centre = vec_cast<double>(camera_centre(c)) + scene.origin;
            const Mat3<double> R = mat_cast<double>(transpose(c.camera_from_world.R));
            JsonValue line;
            const int digits = norm(scene.origin) > 0 ? 15 : 9;
            const auto row = [digits](double x, double y, double z) {
                return std::vector{rounded(x, digits), rounded(y, digits), rounded(z, digits)};
            };
            line.add("id", id)
                .add("img_name", view.name)
                .add("width", c.width_px)
                .add("height", c.height_px);
            line.add("position", row(centre.x, centre.y, centre.z));
            line.add("rotation",
                     std::vector{row(R[0][0], R[0][1], R[0][2]), row(R[1][0], R[1][1], R[1][2]),
                                 row(R[2][0], R[2][1], R[2][2])});
            line.add("fy", c.fy_px).add("fx", c.fx_px).add("cx", c.cx_px).add("cy", c.cy_px);
            line.add("upright_turns", view.upright_turns);
            text += (id++ ? ",\n" : "\n") + json_text(line);
        }
    write_text_file(path_ + "/cameras.json", text + "\n]\n");
}

void RunFolder::log(const JsonValue& line) {
    if (std::fprintf(log_, "%s\n", json_text(line).c_str()) < 0 || std::fflush(log_) != 0)
        throw Error(ExitCode::io, path_, "/log.jsonl: writing failed: ", std::strerror(errno));
}

void RunFolder::save_splats(const Gaussians<Cpu>& gaussians,
                            int iteration,
                            Vec3d origin,
                            PlyScales scales) const {
    write_splat_ply(str(path_, "/point_cloud/iteration_", iteration, "/point_cloud.ply"), gaussians,
                    origin, scales);
}

void RunFolder::remove_splats_of_stops(int last) const {
    const std::string log = read_bytes(path_ + "/log.jsonl");
    std::error_code code;
    for (std::size_t begin = 0, end; (end = log.find('\n', begin)) != std::string::npos;
         begin = end + 1) {
        const std::string_view line(log.data() + begin, end - begin);
        if (line.find("\"event\": \"stopped\"") == std::string_view::npos) continue;
        const int iteration = iteration_of(line);
        if (iteration == last) continue;
        const fs::path folder = str(path_, "/point_cloud/iteration_", iteration);
        fs::remove(folder / "point_cloud.ply", code);
        if (fs::is_empty(folder, code) && !code) fs::remove(folder, code);
    }
}

bool holds_splats(const std::string& run) {
    return newest_splats(run) >= 0;
}

std::string find_splats(const std::string& path) {
    std::error_code code;
    if (fs::is_regular_file(path, code)) return path;
    const int best = newest_splats(path);
    if (best < 0 && fs::is_regular_file(path + "/config.json", code))
        throw input_error(
            path, ": no splats yet; ",
            FolderLock(path).held()
                ? str("it is training; wait for the end")
                : str("continue the stopped training with tvsgs-train --resume ", path));
    if (best < 0)
        throw input_error(path,
                          ": no splats; expected a splat PLY, or a run folder with "
                          "point_cloud/iteration_N/point_cloud.ply");
    return str((fs::path(path) / "point_cloud").string(), "/iteration_", best, "/point_cloud.ply");
}

void choose_backbone(const std::string& file, const BackboneOptions& render, OptionTable& table) {
    if (read_ply_scales(file) != PlyScales::two) return;
    if (!is_pinned(table, "backbone")) table.set("backbone", kDiscs, file);
    require_disc_backbone(file, table.option("backbone").get(), render);
}

Gaussians<Cpu> read_splats(const std::string& file, Vec3d origin, const TrainOptions& train) {
    PlyScales scales;
    Gaussians<Cpu> splats = read_splat_ply(file, origin, &scales);
    if (scales == PlyScales::two) require_disc_backbone(file, train.backbone, train.render);
    if (scales == PlyScales::three && !are_thin(splats) &&
        make_backbone<Cpu>(train.backbone, train.render)->traits.flat)
        throw input_error("E_PLY_SCALES: ", file,
                          ": ellipsoids (splats with three scales), but backbone '", train.backbone,
                          "' draws discs; remove this key, or set one for ellipsoids (",
                          backbones_of(false), ")");
    if (splats.size() == 0) throw input_error(file, ": no usable splats; expected at least one");
    return splats;
}

std::string find_mesh(const std::string& path) {
    std::string found;
    fs::file_time_type latest;
    for (const char* name :
         {"mesh/mesh.glb", "mesh/mesh.ply", "mesh/mesh.obj", "mesh.glb", "mesh.ply", "mesh.obj"}) {
        const fs::path file = fs::path(path) / name;
        std::error_code code;
        if (!fs::is_regular_file(file, code)) continue;
        const fs::file_time_type time = fs::last_write_time(file, code);
        if (found.empty() || time > latest) found = file.string(), latest = time;
    }
    return found;
}

std::string run_config_path(const std::string& path) {
    const std::string config = path + "/config.json";
    std::error_code code;
    if (!fs::is_regular_file(config, code))
        throw input_error(path,
                          ": no run here yet (no config.json); if training has just begun, wait "
                          "for its first step");
    return config;
}

Scene read_scene_of_run(const SceneOptions& options, const std::string& path) {
    return with_context(
        str("reading the scene of ", path, " (for another folder give --scene DIR)"), [&] {
            SceneOptions of_run = options;
            std::error_code code;
            of_run.scratch =
                fs::is_directory(path, code) ? path : fs::path(path).parent_path().string();
            Scene scene = read_scene(of_run);
            if (!options.given_cameras) {
                apply_refined_cameras(path, scene);
                require_scene_of_run(path, scene);
            }
            return scene;
        });
}

}  // namespace tvsgs
