// tvsgs-eval tnt: the evaluation of Tanks and Temples.  docs/evaluation.md
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>

#include "apps/eval/input.h"
#include "apps/eval/subcommands.h"
#include "eval/frame_check.h"
#include "eval/geometry_scores.h"
#include "eval/mesh_metrics.h"
#include "eval/tnt_curves.h"
#include "eval/tnt_protocol.h"
#include "io/atomic_file.h"
#include "io/crop_file.h"
#include "io/manifest.h"
#include "io/read_file.h"
#include "io/trajectory.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

struct TntArguments {
    std::string pred, scene_dir, scene_name, traj, align_file, points = "auto", results, palette,
                                                               out;
    double tau = 0, traj_threshold = 0.2, min_opacity = 0;
    std::uint64_t seed = 0;
    bool no_icp = false, icp_intended = false, force = false;
    std::vector<std::string> require;
};

constexpr const char* kDistribution =
    "  expected DIR/<Scene>.ply, DIR/<Scene>.json, DIR/<Scene>_COLMAP_SfM.log and "
    "DIR/<Scene>_trans.txt;\n  the benchmark distributes them with the training set at "
    "https://www.tanksandtemples.org/download/";

/// The files of one scene.
struct TntFiles {
    std::string scene, cloud, crop, log, trans;
};

/// The scene that --scene-name or the folder names, or the one whose log the folder holds.
TntFiles find_files(const TntArguments& a) {
    const fs::path folder(a.scene_dir);
    std::error_code error;
    if (!fs::is_directory(folder, error))
        throw Error(ExitCode::input, str(a.scene_dir, ": no such folder\n", kDistribution));
    constexpr std::string_view kLog = "_COLMAP_SfM.log";
    std::string scene = a.scene_name;
    if (scene.empty()) scene = fs::absolute(folder / ".").parent_path().filename().string();
    if (a.scene_name.empty() && !fs::exists(folder / (scene + std::string(kLog)))) {
        std::vector<std::string> found;
        for (const auto& entry : fs::directory_iterator(folder))
            if (const std::string name = entry.path().filename().string(); name.ends_with(kLog))
                found.push_back(name.substr(0, name.size() - kLog.size()));
        if (found.size() != 1)
            throw Error(
                ExitCode::input,
                str(a.scene_dir, ": ", found.size(),
                    " files *_COLMAP_SfM.log; name the scene with --scene-name\n", kDistribution));
        scene = found[0];
    }
    const auto file = [&](const std::string& end) { return (folder / (scene + end)).string(); };
    TntFiles files{scene, file(".ply"), file(".json"), file(std::string(kLog)), file("_trans.txt")};
    for (const std::string& path : {files.cloud, files.crop, files.log, files.trans})
        require_file(path, kDistribution);
    return files;
}

/// [TanksAndTemples: config.py], metres
double find_tau(const TntArguments& a, const std::string& scene) {
    if (a.tau > 0) return a.tau;
    const std::map<std::string, double> taus = {
        {"Barn", 0.01},      {"Caterpillar", 0.005}, {"Church", 0.025}, {"Courthouse", 0.025},
        {"Ignatius", 0.003}, {"Meetingroom", 0.01},  {"Truck", 0.005}};
    if (const auto tau = taus.find(scene); tau != taus.end()) return tau->second;
    throw Error(ExitCode::usage, str("scene ", scene,
                                     ": its threshold is not known; give it with --tau, in the "
                                     "unit of the ground truth"));
}

struct Alignment {
    Affine3d start, final;
    std::string how;
    JsonLine json;
};

/// Where the prediction lies in the frame of the truth, by cameras.
void align_by_cameras(const TntArguments& a, const TntFiles& files, Alignment& out) {
    const Affine3d truth_from_log = read_transform(files.trans);
    if (a.traj.empty() ||
        (!fs::is_directory(a.traj) && read_bytes(a.traj) == read_bytes(files.log))) {
        out.start = truth_from_log;
        out.how = "the frame of the official log";
        return;
    }
    CentrePairs pairs = pair_trajectories(a.traj, files.log);
    for (Vec3d& p : pairs.to) p = truth_from_log * p;
    const CentreAlignment fit = align_centres(pairs.from, pairs.to, a.traj_threshold, a.seed);
    out.start = fit.to_from_from;
    out.how = "camera centres of " + a.traj;
    out.json.add("poses", static_cast<std::int64_t>(pairs.poses))
        .add("log_poses", static_cast<std::int64_t>(pairs.log_poses))
        .add("matched_by", pairs.matched_by)
        .add("pairs", static_cast<std::int64_t>(pairs.from.size()))
        .add("inliers", fit.inliers)
        .add("inlier_rmse", fit.rmse)
        .add("median_residual", fit.median_residual);
    spdlog::info("{} of {} camera centres agree within {}; median residual {:.4g}", fit.inliers,
                 pairs.from.size(), a.traj_threshold, fit.median_residual);
    if (2 * static_cast<std::size_t>(fit.inliers) < pairs.from.size() && !a.force)
        throw Error(ExitCode::input,
                    str("E_TNT_TRAJ_RESIDUAL: ", a.traj, ": only ", fit.inliers, " of ",
                        pairs.from.size(), " camera centres come within ", a.traj_threshold,
                        " of those of ", files.log, " (median residual ", fit.median_residual,
                        "): is it the trajectory of another reconstruction? (--force measures "
                        "regardless)"));
}

std::string matrix_text(const Affine3d& T) {
    std::string text;
    for (int r = 0; r < 3; ++r) {
        char line[160];
        std::snprintf(line, sizeof line, "%.17g %.17g %.17g %.17g\n", T.A[r][0], T.A[r][1],
                      T.A[r][2], T.t[r]);
        text += line;
    }
    return text + "0 0 0 1\n";
}

std::string matrix_json(const Affine3d& T) {
    std::string text;
    for (int r = 0; r < 3; ++r) {
        char line[160];
        std::snprintf(line, sizeof line, "[%.17g, %.17g, %.17g, %.17g], ", T.A[r][0], T.A[r][1],
                      T.A[r][2], T.t[r]);
        text += line;
    }
    return "[" + text + "[0, 0, 0, 1]]";
}

Vec3d mean_of(const std::vector<Vec3d>& points) {
    Vec3d sum{};
    for (const Vec3d p : points) sum += p;
    return sum / static_cast<double>(points.size());
}

/// ICP, and how far it moved the prediction.
void refine(const std::vector<Vec3d>& points,
            const std::vector<Vec3d>& truth_cropped,
            const Crop& crop,
            double tau,
            bool intended,
            Alignment& out) {
    const IcpRefinement icp = refine_by_icp(points, truth_cropped, crop, out.start, tau, intended);
    out.final = icp.truth_from_prediction;
    std::vector<JsonLine> stages;
    for (const IcpResult& stage : icp.stages)
        stages.push_back(JsonLine()
                             .add("source", stage.source)
                             .add("target", stage.target)
                             .add("fitness", stage.fitness)
                             .add("rmse", stage.rmse)
                             .add("iterations", stage.iterations));
    const MotionDifference moved = difference(out.final, out.start, mean_of(truth_cropped));
    out.json.add_json("icp_stages", json_list(stages))
        .add("icp_scale", moved.scale)
        .add("icp_angle_rad", moved.angle_rad)
        .add("icp_shift", moved.shift);
    if (std::abs(moved.scale - 1) > 0.02 || moved.shift > 10 * tau)
        spdlog::warn(
            "ICP changed the scale by {:.2f} % and moved the scene by {:.3g}, {:.1f} tau: it may "
            "have slid; compare with --no-icp",
            100 * (moved.scale - 1), moved.shift, moved.shift / tau);
}

/// The points of the prediction that count.
std::vector<Vec3d> choose_points(const Prediction& in, const TntArguments& a, std::string& used) {
    const PreciseMesh& mesh = in.mesh;
    used = a.points != "auto" ? a.points : mesh.faces.empty() ? "vertices" : "vertices+centroids";
    if (in.is_splats) used = "splat centres";
    if (used.starts_with("area:")) {
        int count = 0;
        if (!parse_number(std::string_view(used).substr(5), count) || count < 1)
            throw Error(ExitCode::usage,
                        str("--points ", used, ": expected area: and a positive number"));
        TriangleMesh single{{}, {}, mesh.faces};
        for (const Vec3d p : mesh.vertices) single.vertices.push_back(vec_cast<float>(p));
        std::vector<Vec3d> points;
        for (const Vec3f p : sample_surface(single, static_cast<std::size_t>(count), a.seed))
            points.push_back(vec_cast<double>(p));
        return points;
    }
    std::vector<Vec3d> points = mesh.vertices;
    if (used == "vertices+centroids")
        for (const Vec3i face : mesh.faces) {
            const auto at = [&](int i) { return mesh.vertices[static_cast<std::size_t>(i)]; };
            points.push_back((at(face.x) + at(face.y) + at(face.z)) / 3);
        }
    else if (used != "vertices" && !in.is_splats)
        throw Error(ExitCode::usage, str("--points ", used,
                                         ": expected auto, vertices, vertices+centroids or "
                                         "area:N"));
    return points;
}

void check_overlap(const std::vector<Vec3d>& moved,
                   const std::vector<Vec3d>& truth_cropped,
                   const Crop& crop,
                   const TntArguments& a) {
    if (a.force) return;
    const std::vector<Vec3d> inside = cropped(moved, crop);
    const FrameCheck whole = check_frame(moved, truth_cropped);
    // Far background may be there; what the crop leaves has to have the size of the scene.
    if (!inside.empty() && !whole.apart && check_frame(inside, truth_cropped).plausible()) return;
    throw Error(ExitCode::input,
                str("E_TNT_FRAME: ", a.pred, " does not lie where the ground truth does: aligned, ",
                    whole.text(), "; ", inside.size(), " of its ", moved.size(),
                    " points are inside of the crop volume. Is --traj the trajectory of the frame "
                    "that it was trained in? (--force measures regardless)"));
}

int tnt(const TntArguments& a) {
    const std::vector<Bound> bounds = parse_bounds(a.require);
    const TntFiles files = find_files(a);
    const double tau = find_tau(a, files.scene);

    // 1. Read.
    const Crop crop = read_crop(files.crop);
    const std::vector<Vec3d> truth = read_truth(files.cloud, kDistribution);
    const std::vector<Vec3d> truth_cropped = cropped(truth, crop);
    if (truth_cropped.empty())
        throw Error(ExitCode::input, str("E_CROP: ", files.crop, ": none of the ", truth.size(),
                                         " points of the ground truth is inside; is it the crop "
                                         "volume of this scene?"));
    const Prediction in = read_prediction(a.pred, a.min_opacity);
    std::string used;
    const std::vector<Vec3d> points = choose_points(in, a, used);

    // 2. Align.
    Alignment alignment;
    if (!a.align_file.empty()) {
        alignment.start = read_transform(a.align_file);
        alignment.how = a.align_file;
    } else {
        align_by_cameras(a, files, alignment);
    }
    alignment.final = alignment.start;
    check_overlap(transformed(points, alignment.start), truth_cropped, crop, a);
    const bool icp = !a.no_icp && a.align_file.empty();
    if (icp) refine(points, truth_cropped, crop, tau, a.icp_intended, alignment);

    // 3. Measure and report.
    const TntMetrics m =
        evaluate_tnt(transformed(points, alignment.final), truth_cropped, crop, tau, tau / 2);
    const std::vector<Metric> metrics = {
        {"precision", m.precision}, {"recall", m.recall}, {"f1", m.f1}};
    JsonLine json, counts, inputs;
    json.add("scene", files.scene);
    for (const Metric& metric : metrics)
        json.add(metric.key, m.undefined.empty() ? metric.value : std::nan(""));
    counts.add("vertices", static_cast<std::int64_t>(in.vertices))
        .add("faces", static_cast<std::int64_t>(in.faces))
        .add("dropped_not_finite", static_cast<std::int64_t>(in.dropped))
        .add("dropped_transparent", static_cast<std::int64_t>(in.transparent))
        .add("pred", static_cast<std::int64_t>(points.size()))
        .add("pred_cropped", m.prediction_cropped)
        .add("pred_voxels", static_cast<std::int64_t>(m.prediction.points.size()))
        .add("gt", static_cast<std::int64_t>(truth.size()))
        .add("gt_cropped", m.truth_cropped)
        .add("gt_voxels", static_cast<std::int64_t>(m.truth.points.size()));
    alignment.json.add("by", alignment.how)
        .add("icp", icp ? (a.icp_intended ? "intended" : "official") : "none")
        .add_json("truth_from_prediction", matrix_json(alignment.final))
        .add("scale", scale_of(alignment.final));
    inputs.add("pred", a.pred).add("scene_dir", a.scene_dir).add("traj", a.traj);
    json.add("tau", tau)
        .add("voxel", tau / 2)
        .add("measured", used)
        .add_json("points", counts.text())
        .add_json("alignment", alignment.json.text())
        .add_json("inputs", inputs.text());
    if (!a.results.empty()) list_results(a.results, {});
    put_report(json.text(), a.out);
    if (!m.undefined.empty())
        throw Error(ExitCode::input,
                    str("E_TNT_EMPTY: ", m.undefined, ", so that the metrics are undefined: ",
                        check_frame(transformed(points, alignment.final), truth_cropped).text()));
    if (!a.results.empty()) {
        write_curves(a.results, files.scene, m, tau);
        write_text_file(a.results + "/alignment.txt", matrix_text(alignment.final));
        const ErrorPalette palette = find_palette(a.palette, ErrorPalette::tnt);
        const std::string stem = a.results + "/" + files.scene;
        write_error_cloud(stem + ".precision.ply", m.prediction, palette, 3 * tau);
        write_error_cloud(stem + ".recall.ply", m.truth, palette, 3 * tau);
    }
    return check_bounds(bounds, metrics);
}

}  // namespace

EvalCommand add_eval_tnt(CLI::App& app) {
    const auto arguments = std::make_shared<TntArguments>();
    TntArguments& a = *arguments;
    CLI::App* command =
        app.add_subcommand("tnt", "the evaluation of the Tanks and Temples benchmark");
    command->add_option("--pred", a.pred, "mesh, cloud or splats (PLY)")->required();
    command->add_option("--scene-dir", a.scene_dir, "folder with the scene's ground truth")
        ->required();
    command->add_option("--scene-name", a.scene_name, "name of the scene [that of its files]");
    command->add_option("--traj", a.traj,
                        "cameras in the prediction's frame: .log or COLMAP model [official log]");
    command->add_option("--tau", a.tau, "threshold [that of the scene]")->check(kPositive);
    command->add_option("--points", a.points,
                        "auto, vertices, vertices+centroids or area:N [auto: the third]");
    command->add_flag("--no-icp", a.no_icp, "align by the cameras alone");
    command->add_flag("--icp-intended", a.icp_intended,
                      "20 iterations, as the official script means to do");
    command->add_option("--align-file", a.align_file,
                        "4x4 matrix to the truth's frame, used as it is (alignment.txt of a run)");
    command
        ->add_option("--traj-threshold", a.traj_threshold, "within it camera centres agree [0.2]")
        ->check(kPositive);
    command->add_option("--min-opacity", a.min_opacity, "leaves fainter splats out [0: none]")
        ->check(CLI::Range(0.0, 1.0));
    command->add_option("--seed", a.seed, "of the alignment and of area samples [0]");
    command->add_option("--results", a.results,
                        "folder for curves, alignment.txt and clouds coloured by error");
    command->add_option("--palette", a.palette, "of the clouds: tnt, dtu or safe [tnt]")
        ->check(CLI::IsMember({"dtu", "tnt", "safe"}));
    command->add_flag("--force", a.force, "measure even what seems to be misaligned");
    add_output_flag(*command, "--out", a.out, "JSON file to write as well");
    add_require(*command, a.require, "f1>=0.4");
    return {command, [arguments] { return tnt(*arguments); }};
}

}  // namespace tvsgs
