// tvsgs-prepare: makes a scene with cameras from photographs or a video, with COLMAP.
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>

#include "apps/common/command_line.h"
#include "apps/prepare/check.h"
#include "apps/prepare/colmap.h"
#include "apps/prepare/control_points.h"
#include "apps/prepare/opencv.h"
#include "apps/prepare/photographs.h"
#include "apps/prepare/placement.h"
#include "apps/prepare/reconstruct.h"
#include "core/device/threads.h"
#include "core/log.h"
#include "core/scene/scene.h"
#include "io/files/atomic_file.h"
#include "io/files/read_file.h"
#include "io/scene/georeference.h"
#include "pipeline/run/run_folder.h"
#include "pipeline/run/signals.h"

namespace tvsgs {
namespace {

using namespace prepare;
namespace fs = std::filesystem;

struct Arguments {
    std::string photos, scene, cameras = "auto", matcher = "auto", calibration,
                               dictionary = "DICT_4X4_50", markers_on = "floor", gcp, checkpoints,
                               model;
    ReconstructOptions reconstruct;
    double marker_size = 0;
    int min_share = 50, frames = 150;
    bool gps = false, anew = false;
};

Arguments parse(int argc, char** argv) {
    Arguments a;
    CLI::App app{
        "Makes a scene from photographs or a video: COLMAP finds the camera positions, and a check "
        "says which photographs to take again.",
        "tvsgs-prepare"};
    app.get_formatter()->column_width(40);
    app.add_option("photos", a.photos, "folder of photographs, or a video")->required();
    app.add_option("scene", a.scene, "folder to write, new or empty")->required();
    start_group(app, "Cameras");
    add_choice(app, "--cameras", a.cameras, {"auto", "one", "each"},
               "photographs that share a lens and focal length: auto (by size and EXIF), one "
               "(all), each (none) [auto]");
    add_choice(
        app, "--lens", a.reconstruct.lens,
        {"auto", "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV",
         "FOV", "OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE"},
        "camera model of COLMAP; auto: OPENCV from 10 photographs of a camera on, else "
        "SIMPLE_RADIAL; OPENCV_FISHEYE for a fisheye [auto]");
    app.add_option(
        "--calibration", a.calibration,
        "calibration file of OpenCV (YAML, XML or JSON): the lens of all photographs, not refined");
    app.add_option("--poses", a.reconstruct.poses,
                   "COLMAP model (cameras, images): keep its poses, make the points only");
    app.add_option("--model", a.model,
                   "COLMAP model (.bin files) of these photographs: take its cameras and points, "
                   "without COLMAP");
    start_group(app, "Metric frame");
    app.add_option("--marker-size", a.marker_size,
                   "side of the ArUco or AprilTag markers in the scene, metres: makes the scene "
                   "metric and upright")
        ->check(kPositive);
    app.add_option("--marker-dictionary", a.dictionary,
                   "DICT_4X4_50, DICT_APRILTAG_36h11, ... [DICT_4X4_50]");
    add_choice(app, "--markers-on", a.markers_on, {"floor", "wall"},
               "floor: markers lie flat; wall: markers hang upright [floor]");
    app.add_option("--gcp", a.gcp,
                   "list of control points, gcp_list.txt of OpenDroneMap (projection; lines x y z "
                   "px py image [name]): puts the scene into metres at its true place");
    app.add_option("--checkpoints", a.checkpoints,
                   "names of control points, with commas: only measured, not fitted");
    app.add_flag("--gps", a.gps, "put the scene into metres by the places of the cameras in EXIF");
    start_group(app, "Work");
    add_number(app, "--frames", a.frames, 2, 100000, "most frames to take from a video [150]");
    add_choice(app, "--matcher", a.matcher, {"auto", "exhaustive", "sequential", "transitive"},
               "exhaustive: match all pairs; sequential: neighbours by name; transitive: "
               "neighbours, then pairs that match the same photograph; auto: sequential for a "
               "video, transitive above 200 photographs [auto]");
    add_number(app, "--feature-size", a.reconstruct.feature_size, 100, 65535,
               "longest side of the photographs for the feature search, pixels; larger is slower "
               "and may connect more [2000]");
    add_number(app, "--min-share", a.min_share, 0, 100,
               "share of the photographs that need a pose, per cent [50]");
    app.add_flag("--anew", a.anew, "find cameras again even if there are some");
    start_group(app, "Options");
    add_log_flags(app);
    parse_command_line(app, argc, argv);
    if (app.count("--threads") > 0) a.reconstruct.threads = thread_count();

    // Refuses flags that would have no effect.
    const auto refuse = [&](bool wrong, const char* why) {
        if (wrong) throw usage_error(why);
    };
    std::error_code error;
    const bool folder = fs::is_directory(a.photos, error), video = !folder && is_video(a.photos);
    refuse(!a.calibration.empty() && a.cameras == "each",
           "--calibration and --cameras each exclude each other: the calibration is for one lens");
    refuse(!a.calibration.empty() && a.reconstruct.lens != "auto",
           "--calibration and --lens exclude each other: the file names the lens");
    if (!a.model.empty())
        for (const char* flag : {"--cameras", "--lens", "--calibration", "--poses", "--matcher",
                                 "--feature-size", "--frames", "--anew"})
            if (app.count(flag) > 0)
                throw usage_error(flag, ": has no effect with --model; remove it");
    refuse(video && !a.model.empty(), "--model needs photographs, not a video");
    refuse(video && app.count("--cameras") > 0, "--cameras: a video has one camera; remove it");
    refuse(folder && app.count("--frames") > 0, "--frames: only for a video; remove it");
    refuse(app.count("--marker-size") == 0 &&
               app.count("--markers-on") + app.count("--marker-dictionary") > 0,
           "--markers-on and --marker-dictionary need --marker-size");
    refuse((a.marker_size > 0) + !a.gcp.empty() + a.gps > 1,
           "--marker-size, --gcp and --gps exclude each other: each sets the frame");
    refuse(a.gcp.empty() && !a.checkpoints.empty(), "--checkpoints needs --gcp");
    refuse(video && (a.gps || !a.gcp.empty()), "--gcp and --gps need photographs, not a video");
    return a;
}

/// Folder in which the scene is made; removed at the end unless it is kept. Inside of an existing
/// scene folder, which can be on another disk; else next to the new scene.
class WorkFolder {
public:
    explicit WorkFolder(const fs::path& scene)
        : scene_(scene),
          inside_(fs::exists(scene)),
          path_(inside_ ? scene / str(".partial-", getpid())
                        : scene.parent_path() /
                              str(".", scene.filename().string(), ".partial-", getpid())) {
        fs::create_directories(path_);
    }
    WorkFolder(const WorkFolder&) = delete;
    WorkFolder& operator=(const WorkFolder&) = delete;
    ~WorkFolder() {
        std::error_code no_matter;
        if (!kept_) fs::remove_all(path_, no_matter);
    }
    const fs::path& path() const { return path_; }

    /// Moves the result from `made` to its place. Throws Error(ExitCode::io) if its place is taken;
    /// then the folder stays, because it took hours to make.
    void put(const fs::path& made) {
        try {
            if (!inside_) return fs::rename(made, scene_);
            std::vector<fs::path> parts;
            for (const auto& entry : fs::directory_iterator(made)) parts.push_back(entry.path());
            for (const fs::path& part : parts)
                if (const fs::path to = scene_ / part.filename(); fs::exists(to))
                    throw input_error(to.string(), " exists now");
            for (const fs::path& part : parts) fs::rename(part, scene_ / part.filename());
        } catch (const std::exception& error) {
            kept_ = true;
            throw Error(ExitCode::io,
                        str(scene_.string(), ": cannot move the result there (", error.what(),
                            "); it is in ", made.string(), ": make room and move it"));
        }
    }

private:
    fs::path scene_;
    bool inside_, kept_ = false;
    fs::path path_;
};

/// Removes the empty folders below `folder`.
void remove_empty_folders(const fs::path& folder) {
    std::vector<fs::path> below;
    for (const auto& entry : fs::directory_iterator(folder))
        if (entry.is_directory() && !entry.is_symlink()) below.push_back(entry.path());
    for (const fs::path& each : below) {
        remove_empty_folders(each);
        if (fs::is_empty(each)) fs::remove(each);
    }
}

constexpr const char* kLogHead = "tvsgs-prepare ";

/// COLMAP's output: next to the scene until that exists. Keeps a file of another program.
std::string start_log(const fs::path& scene) {
    std::string path = scene.string() + ".log";
    std::string head;
    std::getline(std::ifstream(path), head);
    if (fs::exists(path) && !head.starts_with(kLogHead))
        path = str(scene.string(), ".", getpid(), ".log");
    std::ofstream(path) << kLogHead << kVersion << "\n";
    if (!fs::exists(path)) throw Error(ExitCode::io, path + ": cannot write it");
    return path;
}

/// Whether SCENE/images becomes a scene in place.
bool is_in_place(const Arguments& a, const fs::path& scene) {
    std::error_code error;
    return fs::is_directory(a.photos, error) && fs::equivalent(a.photos, scene / "images", error);
}

void check_places(const Arguments& a, const fs::path& scene) {
    if (!fs::exists(a.photos)) throw input_error(a.photos, ": no such folder or video");
    if (!fs::is_directory(a.photos) && !is_video(a.photos))
        throw input_error(a.photos,
                          ": expected a folder or a video (.mp4, .mov, .avi, .mkv, .webm)");
    std::error_code error;
    if (is_in_place(a, scene)) {
        for (const char* ours : {"sparse", "prepare.json", "prepare.log", "georeference.json"})
            if (fs::exists(scene / ours))
                throw usage_error((scene / ours).string(), " already exists; choose another scene");
    } else if (fs::exists(fs::symlink_status(scene)) &&  // or a broken link
               !(fs::is_directory(scene, error) && fs::is_empty(scene, error))) {
        throw usage_error(a.scene, ": already exists and is not empty; choose another folder");
    } else if (fs::is_directory(a.photos) && lies_in(scene, a.photos)) {
        throw usage_error(a.scene, ": lies inside ", a.photos,
                          ", so its photographs would be found again; choose a folder elsewhere");
    }
    if (!a.anew && a.reconstruct.poses.empty() && a.model.empty() && fs::is_directory(a.photos))
        if (const std::string model = find_model_of(a.photos); !model.empty())
            throw usage_error(a.photos, ": these photographs have cameras already, in ", model,
                              ": train on that scene, take them with --model MODEL (--poses: "
                              "the poses only), or find all again with --anew");
    if (a.marker_size > 0) {
        const std::vector<std::string> known = marker_dictionaries();
        if (std::ranges::find(known, a.dictionary) == known.end()) {
            throw usage_error(has_opencv()
                                  ? fmt::format("--marker-dictionary {}: expected one of {}",
                                                a.dictionary, fmt::join(known, ", "))
                                  : "--marker-size: this tvsgs-prepare was built without OpenCV "
                                    "(Debian: libopencv-contrib-dev)");
        }
    }
}

/// The model of --model; `renamed`: names of converted photographs. Throws Error(ExitCode::input)
/// if it has other photographs or no points.
SparseModel model_of(const std::string& folder,
                     const std::vector<Photograph>& photographs,
                     const std::map<std::string, std::string>& renamed) {
    if (!fs::exists(folder + "/cameras.bin"))
        throw input_error(folder,
                          ": no cameras.bin; expected a COLMAP model of .bin files, made from "
                          "text by 'colmap model_converter --output_type BIN'");
    SparseModel model = read_sparse_model(folder);
    for (SparseImage& image : model.images) {
        if (const auto now = renamed.find(image.name); now != renamed.end())
            image.name = now->second;
        const auto photo = std::ranges::find(photographs, image.name, &Photograph::name);
        if (photo == photographs.end())
            throw input_error(
                folder, ": has the photograph ", image.name,
                ", which is not in the folder; expected a model of these photographs");
        const SparseCamera& camera = model.camera(image.camera_id);
        const auto has = [&](int width, int height) {
            return camera.width == std::uint64_t(width) && camera.height == std::uint64_t(height);
        };
        if (!has(photo->width, photo->height) && !has(photo->height, photo->width))
            throw input_error(folder, ": the camera of ", image.name, " has ", camera.width, "x",
                              camera.height, " pixels, the photograph ", photo->width, "x",
                              photo->height, "; expected a model of these files");
    }
    std::ranges::sort(model.images, {}, &SparseImage::name);
    if (model.images.size() < 2)
        throw input_error(folder, ": has ", model.images.size(),
                          " photographs with poses; expected 2 or more");
    if (model.points.empty())
        throw input_error(folder, ": has no points; --poses ", folder, " makes them");
    return model;
}

/// Keeps a model that took long to find, and the frames of a video, beside the scene. Returns the
/// command that uses them; empty if they cannot be written.
std::string keep_cameras(const Arguments& a,
                         const fs::path& scene,
                         const SparseModel& model,
                         const std::string& frames) {
    const auto free_place = [&](const char* end) {
        std::string path = scene.string() + end;
        return fs::exists(path) ? str(path, "-", getpid()) : path;
    };
    try {
        const std::string cameras = free_place(".cameras");
        write_sparse_model(cameras, model);
        std::string photos = a.photos;
        if (!frames.empty()) {
            photos = free_place(".frames");
            fs::rename(frames, photos);
        }
        return shell_line({"tvsgs-prepare", photos, a.scene, "--model", cameras});
    } catch (const std::exception& error) {
        spdlog::warn("The cameras could not be kept: {}", error.what());
        return "";
    }
}

/// The calibration scaled to the size of the photographs, which must be the same for all.
Calibration calibration_of(const std::string& file, const Photograph& photo) {
    Calibration lens = read_calibration(file);
    const double scale = static_cast<double>(photo.width) / lens.width;
    if (std::abs(scale * lens.height - photo.height) > 1)
        throw input_error(file, ": calibrated for ", lens.width, "x", lens.height, " pixels, but ",
                          photo.file, " has ", photo.width, "x", photo.height,
                          "; expected that size or shape");
    for (int i = 0; i < 4; ++i) lens.params[static_cast<std::size_t>(i)] *= scale;
    return lens;
}

/// Converts the scene to metres with z up; returns the result for prepare.json.
JsonValue make_metric(const Arguments& a, const fs::path& images, SparseModel& model) {
    std::vector<MarkerView> views;
    std::size_t found = 0;
    for (const SparseImage& image : model.images) {
        SignalGuard::check();
        MarkerView view{intrinsics_of(model.camera(image.camera_id)), image.camera_from_world(),
                        find_markers((images / image.name).string(), a.dictionary)};
        found += view.markers.size();
        views.push_back(std::move(view));
    }
    const MetricFrame frame = metric_frame(views, a.marker_size, a.markers_on == "wall");
    move(model, frame.to_new);
    spdlog::info("Metric scale from {} markers, seen {} times; their sizes agree within {:.1f} %",
                 frame.markers, found, 100 * frame.spread);
    if (frame.spread > 0.05)
        spdlog::warn(
            "The markers differ in size by {:.0f} %, so the scale is uncertain: have all "
            "prints the side of --marker-size?",
            100 * frame.spread);
    if (!frame.upright)
        spdlog::warn(
            "The markers are not in parallel planes: units are metres, but the axes stay as COLMAP "
            "chose them");
    return JsonValue()
        .add("markers", frame.markers)
        .add("spread", frame.spread)
        .add("scale", frame.to_new.scale)
        .add("upright", frame.upright);
}

/// Moves the model to its true place, and writes its projection into the folder `made`. Returns the
/// result for prepare.json.
JsonValue put_in_place(const GeoFrame& frame, const fs::path& made, SparseModel& model) {
    move(model, frame.to_world);
    std::vector<Vec3d> centres;
    for (const SparseImage& image : model.images)
        centres.push_back(inverse(image.camera_from_world()).t);
    write_georeference(made.string(), {frame.projection, local_origin(centres)});
    spdlog::info("The scene is in metres: {}", frame.projection);
    return frame.report;
}

}  // namespace

int command(int argc, char** argv) {
    // 1. Find the photographs.
    Arguments a = parse(argc, argv);
    fs::path scene = fs::weakly_canonical(fs::absolute(a.scene));  // the target of a link
    if (!scene.has_filename()) scene = scene.parent_path();
    check_places(a, scene);
    const std::string colmap = a.model.empty() ? find_colmap() : "";
    const SignalGuard signals;
    fs::create_directories(scene.parent_path());
    WorkFolder work(scene);
    const bool in_place = is_in_place(a, scene);
    const fs::path made = work.path() / "scene", images = (in_place ? scene : made) / "images";
    std::string photos = a.photos;
    const bool video = !fs::is_directory(a.photos);
    if (video) {
        photos = (work.path() / "frames").string();
        fs::create_directories(photos);
        spdlog::info("{}: took {} frames", a.photos, extract_frames(a.photos, photos, a.frames));
    }
    const std::vector<Photograph> photographs = find_photographs(photos);
    std::optional<ControlPoints> control;
    if (!a.gcp.empty()) control = read_control_points(a.gcp, photographs, a.checkpoints);
    if (a.gps) require_places(photographs, photos);
    if (!a.calibration.empty()) {
        a.reconstruct.calibration = calibration_of(a.calibration, photographs.front());
        a.cameras = "one";
    }
    const std::vector<CameraGroup> groups =
        group_by_camera(photographs, a.cameras == "one" || video ? Sharing::one
                                     : a.cameras == "each"       ? Sharing::each
                                                                 : Sharing::automatic);
    constexpr std::size_t kExhaustive = 200;  // half an hour on 16 cores; grows with the square
    a.reconstruct.matcher = a.matcher != "auto"                ? a.matcher
                            : video                            ? "sequential"
                            : photographs.size() > kExhaustive ? "transitive"
                                                               : "exhaustive";

    for (const Photograph& photo : photographs) {
        a.reconstruct.longest_side =
            std::max({a.reconstruct.longest_side, photo.width, photo.height});
        if (photo.convert)
            a.reconstruct
                .renamed[fs::path(photo.file).lexically_relative(photos).generic_string()] =
                photo.name;
    }

    // 2. Estimate the cameras.
    if (!in_place)
        put_photographs(photographs, images.string());
    else if (std::ranges::any_of(photographs, &Photograph::convert))
        throw usage_error(a.photos,
                          ": TIFF and WebP need a copy as PNG; choose another scene folder");
    const std::string log = a.model.empty() ? start_log(scene) : "";
    Reconstruction found;
    if (!a.model.empty())
        found.models = {model_of(a.model, photographs, a.reconstruct.renamed)};
    else
        found = with_context(str("preparing ", a.scene, " (messages of COLMAP: ", log, ")"), [&] {
            return reconstruct(colmap, work.path(), images, log, groups, a.reconstruct);
        });
    std::vector<std::string> names;
    for (const Photograph& photo : photographs) names.push_back(photo.name);
    SparseModel& model = found.models[0];
    std::size_t registered = 0;
    try {
        const Check check = check_models(names, found.models, found.features);
        log_check(check);
        registered = check.registered;
        if (registered * 100 < check.photographs * static_cast<std::size_t>(a.min_share))
            throw input_error(
                a.photos, ": ", registered, " of ", check.photographs,
                " photographs have poses, expected ", a.min_share,
                " % or more; add photographs as listed above, or accept it with --min-share ",
                registered * 100 / check.photographs,
                log.empty() ? "" : "; messages of COLMAP: " + log);

        // 3. Write the complete scene, then give it its name.
        JsonValue report = json_of(check);
        if (a.model.empty()) {
            report.set("colmap", found.colmap);
            report.set("feature_size", a.reconstruct.feature_size);
        }
        if (a.marker_size > 0) report.set("metric", make_metric(a, images, model));
        if (control || a.gps)
            report.set("georeference",
                       put_in_place(control ? place_by_control_points(model, *control)
                                            : place_by_exif(model, photographs),
                                    made, model));
        write_sparse_model((made / "sparse/0").string(), model);
        write_text_file((made / "prepare.json").string(), json_text(report) + "\n");
        if (!log.empty()) fs::copy_file(log, made / "prepare.log");
    } catch (const std::exception& error) {
        if (!a.model.empty() || SignalGuard::received() != 0) throw;
        const std::string command = keep_cameras(a, scene, model, video ? photos : "");
        if (command.empty()) throw;
        const Error* const known = dynamic_cast<const Error*>(&error);
        throw Error(known ? known->code() : ExitCode::io, error.what(),
                    "\n  The cameras are kept. After a correction, with --gcp, --gps or "
                    "--marker-size as before: ",
                    command);
    }
    if (!in_place) {
        for (const std::string& name : names)
            if (!std::ranges::binary_search(model.images, name, {}, &SparseImage::name))
                fs::remove(images / name);
        remove_empty_folders(images);
    }
    work.put(made);
    if (!log.empty()) fs::remove(log);
    spdlog::info("Wrote {}: {} photographs with cameras", a.scene, registered);
    say_next({"tvsgs-train", "--scene", a.scene}, "train on it");
    return 0;
}

}  // namespace tvsgs
