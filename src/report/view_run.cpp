#include <algorithm>
#include <filesystem>

#include "core/log.h"
#include "core/math/quantile.h"
#include "core/scene/scene.h"
#include "io/files/read_file.h"
#include "io/images/image_file.h"
#include "io/mesh/mesh_files.h"
#include "io/scene/georeference.h"
#include "io/splats/splat_files.h"
#include "mesh/simplify/simplify.h"
#include "pipeline/run/run_folder.h"
#include "pipeline/run/run_options.h"
#include "plan/decide.h"
#include "report/report.h"
#include "report/view_page.h"

namespace tvsgs {
namespace {

constexpr std::size_t kFewPhotos = 12;  // from a scene that was loaded for another purpose

namespace fs = std::filesystem;

RunOptions options_of(const std::string& run) {
    Configuration configuration;
    auto& [options, table] = configuration;
    table.read_file(run_config_path(run));
    options.scene.need_points = false;
    options.scene.min_train_views = 1;
    return options;
}

/// An entry of cameras.json. Its `centre` stays in double; the camera has no position.
ViewCamera file_camera(const JsonValue& json, const std::string& path, Vec3d& centre) {
    const auto require = [&](bool complete) {
        if (!complete)
            throw input_error(path, ": a camera lacks numbers; expected the file of tvsgs-train");
    };
    const auto number = [&](const JsonValue& value) {
        require(value.is(JsonValue::Kind::number));
        return value.number;
    };
    const auto vector = [&](const JsonValue& list) {
        const Vec3d v = vector_of(list);
        require(is_finite(v));
        return v;
    };
    ViewCamera out{.name = json["img_name"].text};
    centre = vector(json["position"]);
    Camera& c = out.camera;
    const auto size = [&](const char* key) {
        const double pixels = number(json[key]);
        if (!(pixels >= 1 && pixels <= 65535))
            throw input_error(path, ": a camera's ", key, " is ", pixels,
                              " px; expected 1 to 65535");
        return static_cast<int>(pixels);
    };
    c.width_px = size("width"), c.height_px = size("height");
    c.fx_px = static_cast<float>(number(json["fx"]));
    c.fy_px = static_cast<float>(number(json["fy"]));
    const auto middle = [&](const char* key, int pixels) {
        return static_cast<float>(json[key].number_or(0.5 * pixels));
    };
    c.cx_px = middle("cx", c.width_px), c.cy_px = middle("cy", c.height_px);
    if (!(c.fx_px > 0) || !(c.fy_px > 0))
        throw input_error(path, ": a camera has a focal length of 0 px or less");
    const auto& rows = json["rotation"].items;  // world_from_camera
    if (rows.size() != 3)
        throw input_error(path, ": a camera lacks its rotation; expected the file of tvsgs-train");
    for (std::size_t r = 0; r < 3; ++r) {
        const Vec3d row = vector(rows[r]);
        for (int k = 0; k < 3; ++k) c.camera_from_world.R[k][r] = static_cast<float>(row[k]);
    }
    const double turns = json["upright_turns"].number_or(0);
    if (!(turns == 0 || turns == 1 || turns == 2 || turns == 3))
        throw input_error(path, ": a camera's upright_turns is ", turns, "; expected 0 to 3");
    out.upright_turns = static_cast<int>(turns);
    c = turned_camera(c, out.upright_turns);
    return out;
}

/// Reads the cameras into a frame close to zero.
void read_cameras(const std::string& run, ViewSubject& subject) {
    const std::string path = run + "/cameras.json";
    std::vector<Vec3d> centres;
    for (const JsonValue& entry : parse_json_value(read_bytes(path), path).items)
        subject.cameras.push_back(file_camera(entry, path, centres.emplace_back()));
    if (centres.empty()) throw input_error(path, ": no cameras; expected at least one");
    subject.origin = local_origin(centres);
    for (std::size_t i = 0; i < centres.size(); ++i) {
        Rigid3f& pose = subject.cameras[i].camera.camera_from_world;
        pose.t = -(pose.R * vec_cast<float>(centres[i] - subject.origin));
    }
}

/// Marks test views, and adds at most `most` evenly spaced photographs. Copies those of a constant
/// scene.
template <class AnyScene>
void add_photographs(std::vector<ViewCamera>& cameras, AnyScene& scene, std::size_t most) {
    const std::size_t n = cameras.size(), kept = std::min(n, most);
    std::vector<bool> chosen(n);
    for (std::size_t k = 0; k < kept; ++k) chosen[kept < 2 ? 0 : k * (n - 1) / (kept - 1)] = true;
    for (auto* views : {&scene.train, &scene.test})
        for (auto& view : *views)
            for (std::size_t i = 0; i < n; ++i) {
                if (cameras[i].name != view.name) continue;
                cameras[i].test = views == &scene.test;
                if (chosen[i])
                    cameras[i].photo =
                        turned_clockwise(std::move(view.photo), cameras[i].upright_turns);
            }
}

/// The truth that the run was measured against, in training or by tvsgs-eval run.
EvaluationOptions truth_options(const EvaluationOptions& of_run, const std::string& run) {
    if (!of_run.gt.empty()) return of_run;
    EvaluationOptions options = of_run;
    for (const char* name : {"geometry", "geometry_centres"}) {
        const std::string path = str(run, "/eval/", name, ".json");
        if (!is_file(path) || !options.gt.empty()) continue;
        const JsonValue measured = parse_json_value(read_bytes(path), path);
        options.gt = measured["inputs"]["gt"].text, options.crop = measured["inputs"]["crop"].text;
        options.taus.clear();
        for (const JsonValue& at : measured["thresholds"].items)
            options.taus += str(options.taus.empty() ? "" : ",", at["tau"].number);
    }
    return options;
}

ViewRun read_run(const std::string& path, const ViewInput& input, ViewSubject& subject) {
    const Vec3d origin = subject.origin;
    std::vector<std::string>* const missing = &subject.missing;
    const RunOptions options = options_of(path);
    ViewRun run;
    run.name = folder_name(path);
    run.train = options.train;
    std::error_code code;
    if (input.may_train && !fs::exists(path + "/point_cloud", code))
        resize(run.splats, 0, 0);
    else
        run.splats = read_splats(find_splats(path), origin, options.train);
    const auto read_mesh_of_run = [&] {
        const std::string file = find_mesh(path);
        if (file.empty()) return;
        PlyContents read = read_mesh(file, origin, true, &run.texture);
        TriangleMesh mesh{std::move(read.points.positions), std::move(read.points.colors),
                          std::move(read.faces)};
        check_mesh(file, mesh);
        run.mesh_faces = mesh.faces.size();
        std::vector<Camera> all;
        for (const ViewCamera& c : subject.cameras) all.push_back(c.camera);
        if (run.mesh_faces > input.max_faces) {
            run.texture = {};
            simplify_and_log(mesh, all, {0, static_cast<int>(input.max_faces)});
        }
        run.mesh = std::move(mesh);
    };
    if_possible("a mesh", read_mesh_of_run, input.whole, missing);
    if (input.gt.empty()) {
        if_possible(
            "colours by error",
            [&] { run.truth = read_truth(truth_options(options.eval, path), origin); }, input.whole,
            missing);
    } else {
        EvaluationOptions measure;
        measure.gt = input.gt, measure.crop = input.crop;
        run.truth = read_truth(measure, origin);
    }
    if_possible(
        "plots",
        [&] {
            const std::string report = path + "/report.json";
            if (is_file(report))
                run.evaluations = parse_json_value(read_bytes(report), report)["evaluations"];
        },
        input.whole, missing);
    return run;
}

/// Whether the scene's unit is known to be the metre: it has a projection, or its preparation used
/// markers (prepare.json).
bool in_metres(const std::string& run, const std::string& scene) {
    const std::string prepared = scene + "/prepare.json";
    return is_file(run + "/georeference.json") || is_file(scene + "/georeference.json") ||
           (is_file(prepared) && parse_json_value(read_bytes(prepared), prepared)["metric"]);
}

/// Whether a camera of the run has name and place of one on the page.
bool share_a_camera(const ViewSubject& subject, const std::string& run) {
    ViewSubject other;
    read_cameras(run, other);
    const auto centre = [](const ViewSubject& of, const ViewCamera& c) {
        return vec_cast<double>(camera_centre(c.camera)) + of.origin;
    };
    Vec3d middle;
    double radius = 0;
    for (const ViewCamera& c : subject.cameras)
        middle += centre(subject, c) / double(subject.cameras.size());
    for (const ViewCamera& c : subject.cameras)
        radius = std::max(radius, norm(centre(subject, c) - middle));
    constexpr double kSame = 0.05;  // of the radius; poses may be refined
    for (const ViewCamera& a : subject.cameras)
        for (const ViewCamera& b : other.cameras)
            if (a.name == b.name &&
                norm(centre(subject, a) - centre(other, b)) <= kSame * radius + 1e-6)
                return true;
    return false;
}

/// A camera that looks at most of the splats along +z.
Camera camera_at(const Gaussians<Cpu>& splats) {
    Vec3f middle, half;
    for (int a = 0; a < 3; ++a) {
        std::vector<double> values;
        for (const Vec3f mean : splats.means.span()) values.push_back(mean[a]);
        const double low = quantile(values, 0.02), high = quantile(values, 0.98);
        middle[a] = float(0.5 * (low + high)), half[a] = float(0.5 * (high - low));
    }
    Camera c;
    c.width_px = 800, c.height_px = 600, c.fx_px = c.fy_px = 800;
    c.cx_px = 400, c.cy_px = 300;
    c.camera_from_world.t = Vec3f{0, 0, std::max(3 * norm(half), 1e-3f)} - middle;
    return c;
}

/// The content of a page for a file of splats: no run, no photographs.
ViewSubject read_splat_subject(const ViewInput& input) {
    const std::string& path = input.runs.front();
    if (input.runs.size() > 1)
        throw Error(ExitCode::usage, path, ": is a file; two runs side by side are two folders");
    ViewRun run;
    run.name = fs::path(path).stem().string();
    if (splat_format(path) == SplatFormat::ply && read_ply_scales(path) == PlyScales::two)
        run.train.backbone = kDiscs;
    run.splats = read_splat_file(path);
    if (run.splats.size() == 0)
        throw input_error(path, ": no usable splats; expected at least one");
    std::vector<Vec3d> places;
    for (const Vec3f mean : run.splats.means.span()) places.push_back(vec_cast<double>(mean));
    ViewSubject subject;
    subject.origin = local_origin(places);
    if (norm(subject.origin) > 0) run.splats = read_splat_file(path, {}, subject.origin);
    EvaluationOptions measure;
    measure.gt = input.gt, measure.crop = input.crop;
    run.truth = read_truth(measure, subject.origin);
    subject.cameras.push_back({"front", false, camera_at(run.splats), {}});
    subject.runs.push_back(std::move(run));
    return subject;
}

}  // namespace

ViewSubject read_view_subject(const ViewInput& input) {
    if (is_file(input.runs.front())) return read_splat_subject(input);
    ViewSubject subject;
    RunOptions first = options_of(input.runs.front());
    read_cameras(input.runs.front(), subject);
    if (!input.scene.empty()) first.scene.path = input.scene;
    if_possible(
        "the unit", [&] { subject.metres = in_metres(input.runs.front(), first.scene.path); },
        input.whole, &subject.missing);
    const auto read = [&] {
        Scene scene = read_scene_of_run(first.scene, input.runs.front());
        add_photographs(subject.cameras, scene, subject.cameras.size());
    };
    if (input.loaded != nullptr)
        add_photographs(subject.cameras, *input.loaded, kFewPhotos);
    else
        if_possible("photographs", read, input.whole, &subject.missing);
    for (const std::string& run : input.runs) {
        if (subject.runs.size() == 1 && !share_a_camera(subject, run))
            spdlog::warn("{} and {} share no camera: are they runs of one scene?",
                         input.runs.front(), run);
        subject.runs.push_back(read_run(run, input, subject));
    }
    return subject;
}

}  // namespace tvsgs
