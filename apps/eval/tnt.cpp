// tvsgs-eval tnt: the evaluation of Tanks and Temples. docs/guide/evaluation.md
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <string_view>

#include "apps/eval/subcommands.h"
#include "core/grouped.h"
#include "eval/benchmark_files.h"
#include "eval/mesh_metrics.h"
#include "eval/protocols.h"
#include "io/files/atomic_file.h"
#include "io/files/manifest.h"
#include "io/files/read_file.h"
#include "io/scene/crop_file.h"
#include "io/scene/trajectory.h"
#include "report/plot.h"

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

/// Where the benchmark distributes its files.
constexpr const char* kDistribution =
    "  expected DIR/<Scene>.ply, DIR/<Scene>.json, DIR/<Scene>_COLMAP_SfM.log and "
    "DIR/<Scene>_trans.txt;\n  they come with the training set of the benchmark: "
    "https://www.tanksandtemples.org/download/";

/// The files of one scene.
struct TntFiles {
    std::string scene, cloud, crop, log, trans;
};

/// Finds the scene by `scene_name`, by the folder's name, or by the log file in the folder.
TntFiles find_files(const std::string& scene_dir, const std::string& scene_name) {
    const fs::path folder(scene_dir);
    std::error_code error;
    if (!fs::is_directory(folder, error))
        throw input_error(scene_dir, ": folder not found\n", kDistribution);
    constexpr std::string_view kLog = "_COLMAP_SfM.log";
    std::string scene = scene_name;
    if (scene.empty()) scene = fs::absolute(folder / ".").parent_path().filename().string();
    if (scene_name.empty() && !fs::exists(folder / (scene + std::string(kLog)))) {
        std::vector<std::string> found;
        for (const auto& entry : fs::directory_iterator(folder))
            if (const std::string name = entry.path().filename().string(); name.ends_with(kLog))
                found.push_back(name.substr(0, name.size() - kLog.size()));
        if (found.size() != 1)
            throw input_error(scene_dir, ": ", found.size(),
                              " files *_COLMAP_SfM.log; name the scene with --scene-name\n",
                              kDistribution);
        scene = found[0];
    }
    const auto file = [&](const std::string& end) { return (folder / (scene + end)).string(); };
    TntFiles files{scene, file(".ply"), file(".json"), file(std::string(kLog)), file("_trans.txt")};
    for (const std::string& path : {files.cloud, files.crop, files.log, files.trans})
        require_file(path, kDistribution);
    return files;
}

/// The given threshold, or that of the scene in metres.  [TanksAndTemples: config.py]
double find_tau(double given, const std::string& scene) {
    if (given > 0) return given;
    const std::map<std::string, double> taus = {
        {"Barn", 0.01},      {"Caterpillar", 0.005}, {"Church", 0.025}, {"Courthouse", 0.025},
        {"Ignatius", 0.003}, {"Meetingroom", 0.01},  {"Truck", 0.005}};
    if (const auto tau = taus.find(scene); tau != taus.end()) return tau->second;
    throw usage_error("scene ", scene,
                      ": no known threshold; give --tau, in the units of the truth");
}

struct TntAlignment {
    Affine3d start, final;
    std::string how;
    JsonValue json;
};

/// Aligns the prediction with the truth by camera centres, from the trajectory or, without one, the
/// official log. Throws Error(ExitCode::input) where too few centres agree, unless --force.
TntAlignment align_by_cameras(const TntArguments& a, const TntFiles& files) {
    TntAlignment out;
    const Affine3d truth_from_log = read_transform(files.trans);
    if (a.traj.empty() ||
        (!fs::is_directory(a.traj) && read_bytes(a.traj) == read_bytes(files.log))) {
        out.start = truth_from_log;
        out.how = "the frame of the official log";
        return out;
    }
    CentrePairs pairs = pair_trajectories(a.traj, files.log);
    for (Vec3d& p : pairs.to) p = truth_from_log * p;
    const CentreAlignment fit = align_centres(pairs.from, pairs.to, a.traj_threshold, a.seed);
    out.start = fit.to_from_from;
    out.how = "camera centres of " + a.traj;
    out.json.add("poses", pairs.poses)
        .add("log_poses", pairs.log_poses)
        .add("matched_by", pairs.matched_by)
        .add("pairs", pairs.from.size())
        .add("inliers", fit.inliers)
        .add("inlier_rmse", fit.rmse)
        .add("median_residual", fit.median_residual);
    spdlog::info("{} of {} camera centres agree within {}; median error {:.4g}", fit.inliers,
                 pairs.from.size(), a.traj_threshold, fit.median_residual);
    if (2 * static_cast<std::size_t>(fit.inliers) < pairs.from.size() && !a.force)
        throw input_error(
            "E_TNT_TRAJ_RESIDUAL: ", a.traj, ": only ", fit.inliers, " of ", pairs.from.size(),
            " camera centres are within ", a.traj_threshold, " of those in ", files.log,
            " (median error ", fit.median_residual,
            "); is the trajectory of another reconstruction? --force measures anyway");
    return out;
}

/// Refines the alignment by ICP, and measures how far that moved the prediction.
void refine(const Points& points,
            const Points& truth_cropped,
            const Crop& crop,
            double tau,
            bool intended,
            TntAlignment& out) {
    const IcpRefinement icp = refine_by_icp(points, truth_cropped, crop, out.start, tau, intended);
    out.final = icp.truth_from_prediction;
    std::vector<JsonValue> stages;
    for (const IcpResult& stage : icp.stages)
        stages.push_back(JsonValue()
                             .add("source", stage.source)
                             .add("target", stage.target)
                             .add("fitness", stage.fitness)
                             .add("rmse", stage.rmse)
                             .add("iterations", stage.iterations));
    Vec3d sum;
    for (const Vec3d p : truth_cropped) sum += p;
    const MotionDifference moved =
        difference(out.final, out.start, sum / static_cast<double>(truth_cropped.size()));
    out.json.add("icp_stages", stages)
        .add("icp_scale", moved.scale)
        .add("icp_angle_rad", moved.angle_rad)
        .add("icp_shift", moved.shift);
    if (std::abs(moved.scale - 1) > 0.02 || moved.shift > 10 * tau)
        spdlog::warn(
            "ICP changed the scale by {:.2f} % and moved the scene by {:.3g} ({:.1f} tau); it may "
            "be wrong, compare with --no-icp",
            100 * (moved.scale - 1), moved.shift, moved.shift / tau);
}

/// Selects the points to evaluate; sets `used` to the resolved choice.
Points choose_points(const Prediction& in, const TntArguments& a, std::string& used) {
    const PreciseMesh& mesh = in.mesh;
    used = a.points != "auto" ? a.points : mesh.faces.empty() ? "vertices" : "vertices+centroids";
    if (in.is_splats) used = "splat centres";
    if (used.starts_with("area:")) {
        int count = 0;
        if (!parse_number(std::string_view(used).substr(5), count) || count < 1)
            throw usage_error("--points ", used, ": expected area:N with N above 0");
        TriangleMesh single{{}, {}, mesh.faces};
        for (const Vec3d p : mesh.vertices) single.vertices.push_back(vec_cast<float>(p));
        Points points;
        for (const Vec3f p : sample_surface(single, static_cast<std::size_t>(count), a.seed))
            points.push_back(vec_cast<double>(p));
        return points;
    }
    Points points = mesh.vertices;
    if (used == "vertices+centroids")
        for (const Vec3i face : mesh.faces) {
            const auto& v = mesh.vertices;
            points.push_back((v[face.x] + v[face.y] + v[face.z]) / 3);
        }
    else if (used != "vertices" && !in.is_splats)
        throw usage_error("--points ", used,
                          ": expected auto, vertices, vertices+centroids or area:N");
    return points;
}

/// Throws Error(ExitCode::input) unless the aligned points overlap the truth.
void check_overlap(const Points& moved,
                   const Points& truth_cropped,
                   const Crop& crop,
                   const std::string& name) {
    const Points inside = cropped(moved, crop);
    const FrameCheck whole = check_frame(moved, truth_cropped);
    // There may be a distant background; inside the crop the sizes must agree.
    if (!inside.empty() && !whole.apart && check_frame(inside, truth_cropped).plausible()) return;
    throw input_error(
        "E_TNT_FRAME: ", name, " does not lie at the truth: after alignment ", whole.text(), "; ",
        grouped(inside.size()), " of its ", grouped(moved.size()),
        " points are inside the crop volume. Is --traj the trajectory of the training? "
        "--force measures anyway");
}

/// Numbers in the format of numpy.savetxt.
std::string lines(const std::vector<double>& values) {
    std::string text;
    for (const double v : values) text += fmt::format("{:.18e}\n", v);
    return text;
}

/// Writes FOLDER/<scene>.precision.txt, .recall.txt, .prf_tau_plotstr.txt and
/// PR_<scene>_@d_th_0_*.svg.
void write_curves(const std::string& folder,
                  const std::string& scene,
                  const TntMetrics& m,
                  double tau) {
    const std::string stem = folder + "/" + scene;
    write_text_file(stem + ".precision.txt", lines(m.precision_curve));
    write_text_file(stem + ".recall.txt", lines(m.recall_curve));
    write_text_file(stem + ".prf_tau_plotstr.txt", lines({m.precision, m.recall, m.f1, tau, 5}));
    const std::vector<double> upper(m.edges.begin() + 1, m.edges.end());
    Plot plot;
    plot.title = fmt::format("{}: P {:.4f}, R {:.4f}, F1 {:.4f} at {:g}", scene, m.precision,
                             m.recall, m.f1, tau);
    plot.x_label = "distance", plot.y_label = "share of points", plot.y_from_zero = true;
    plot.series = {{"precision", upper, m.precision_curve, {}, {}},
                   {"recall", upper, m.recall_curve, {}, {}}};
    write_text_file(
        fmt::format("{}/PR_{}_@d_th_0_{:04}.svg", folder, scene, std::lround(10000 * tau)),
        standalone_svg(plot_svg(plot, "curves")));
}

std::string matrix_text(const Affine3d& T) {
    std::string text;
    for (int r = 0; r < 3; ++r)
        text += fmt::format("{:.17g} {:.17g} {:.17g} {:.17g}\n", T.A[r][0], T.A[r][1], T.A[r][2],
                            T.t[r]);
    return text + "0 0 0 1\n";
}

JsonValue matrix_json(const Affine3d& T) {
    JsonValue rows = JsonValue::list();
    for (int r = 0; r < 3; ++r)
        rows.items.push_back(std::vector{T.A[r][0], T.A[r][1], T.A[r][2], T.t[r]});
    rows.items.push_back(std::vector{0, 0, 0, 1});
    return rows;
}

int tnt(const TntArguments& a) {
    const std::vector<Bound> bounds = parse_bounds(a.require, {"precision", "recall", "f1"});
    const TntFiles files = find_files(a.scene_dir, a.scene_name);
    const double tau = find_tau(a.tau, files.scene);
    if (!a.results.empty())
        create_results_folder(a.results,
                              {"alignment.txt", files.scene + ".precision.txt",
                               files.scene + ".recall.txt", files.scene + ".prf_tau_plotstr.txt",
                               files.scene + ".precision.ply", files.scene + ".recall.ply"});

    // 1. Read.
    const Crop crop = read_crop(files.crop);
    const std::vector<Vec3d> truth = read_truth(files.cloud, kDistribution);
    const std::vector<Vec3d> truth_cropped = cropped(truth, crop);
    if (truth_cropped.empty())
        throw input_error("E_CROP: ", files.crop, ": none of the ", grouped(truth.size()),
                          " points of the truth is inside; is it the crop volume of this scene?");
    const Prediction in = read_prediction(a.pred, a.min_opacity);
    std::string used;
    const std::vector<Vec3d> points = choose_points(in, a, used);

    // 2. Align.
    TntAlignment alignment;
    if (!a.align_file.empty()) {
        alignment.start = read_transform(a.align_file);
        alignment.how = a.align_file;
    } else {
        alignment = align_by_cameras(a, files);
    }
    alignment.final = alignment.start;
    if (!a.force) check_overlap(transformed(points, alignment.start), truth_cropped, crop, a.pred);
    const bool icp = !a.no_icp && a.align_file.empty();
    if (icp) refine(points, truth_cropped, crop, tau, a.icp_intended, alignment);

    // 3. Measure and report.
    const TntMetrics m =
        evaluate_tnt(transformed(points, alignment.final), truth_cropped, crop, tau, tau / 2);
    JsonValue json, counts, inputs;
    json.add("scene", files.scene);
    for (const auto& [key, value] :
         {std::pair("precision", m.precision), {"recall", m.recall}, {"f1", m.f1}})
        json.add(key, m.undefined.empty() ? value : std::nan(""));
    counts.add("vertices", in.vertices)
        .add("faces", in.faces)
        .add("dropped_not_finite", in.dropped)
        .add("dropped_transparent", in.transparent)
        .add("pred", points.size())
        .add("pred_cropped", m.prediction_cropped)
        .add("pred_voxels", m.prediction.points.size())
        .add("gt", truth.size())
        .add("gt_cropped", m.truth_cropped)
        .add("gt_voxels", m.truth.points.size());
    alignment.json.add("by", alignment.how)
        .add("icp", icp ? (a.icp_intended ? "intended" : "official") : "none")
        .add("truth_from_prediction", matrix_json(alignment.final))
        .add("scale", scale_of(alignment.final));
    inputs.add("pred", a.pred).add("scene_dir", a.scene_dir).add("traj", a.traj);
    json.add("tau", tau)
        .add("voxel", tau / 2)
        .add("measured", used)
        .add("points", counts)
        .add("alignment", alignment.json)
        .add("inputs", inputs);
    put_report(json, a.out);
    if (!m.undefined.empty())
        throw input_error("E_TNT_EMPTY: ", m.undefined, "; nothing can be measured: ",
                          check_frame(transformed(points, alignment.final), truth_cropped).text());
    if (!a.results.empty()) {
        write_curves(a.results, files.scene, m, tau);
        write_text_file(a.results + "/alignment.txt", matrix_text(alignment.final));
        const ErrorPalette palette = find_palette(a.palette, ErrorPalette::tnt);
        const std::string stem = a.results + "/" + files.scene;
        write_error_cloud(stem + ".precision.ply", m.prediction, palette, 3 * tau);
        write_error_cloud(stem + ".recall.ply", m.truth, palette, 3 * tau);
    }
    return check_bounds(bounds, json);
}

}  // namespace

Subcommand add_eval_tnt(CLI::App& app) {
    const auto a = std::make_shared<TntArguments>();
    CLI::App* command =
        app.add_subcommand("tnt", "measure as the Tanks and Temples benchmark does");
    command->add_option("--pred", a->pred, "mesh, cloud or splats (PLY)")->required();
    command->add_option("--scene-dir", a->scene_dir, "folder with the truth of the scene")
        ->required();
    command->add_option("--scene-name", a->scene_name, "name of the scene [that of its files]");
    command->add_option("--traj", a->traj,
                        "cameras in the prediction's frame: .log or COLMAP model [official log]");
    command->add_option("--tau", a->tau, "threshold [that of the scene]")->check(kPositive);
    command->add_option("--points", a->points,
                        "points of a mesh: vertices, vertices+centroids or area:N; auto: "
                        "vertices+centroids [auto]");
    command->add_flag("--no-icp", a->no_icp, "align by the cameras only");
    command
        ->add_flag("--icp-intended", a->icp_intended,
                   "20 iterations of ICP, as the official script intends")
        ->excludes("--no-icp");
    command
        ->add_option(
            "--align-file", a->align_file,
            "4x4 matrix into the frame of the truth, used without ICP (alignment.txt of a run)")
        ->excludes("--traj")
        ->excludes("--icp-intended");
    command
        ->add_option("--traj-threshold", a->traj_threshold,
                     "largest distance at which camera centres agree [0.2]")
        ->check(kPositive);
    add_number(*command, "--min-opacity", a->min_opacity, 0.0, 1.0,
               "skip splats below this opacity [0: none]");
    command->add_option("--seed", a->seed, "seed of the alignment and of area samples [0]");
    command->add_option("--results", a->results,
                        "folder for curves, alignment.txt and clouds coloured by error");
    add_choice(*command, "--palette", a->palette, {"dtu", "tnt", "safe"},
               "colours of the clouds: tnt, dtu or safe (colour-blind) [tnt]");
    command->add_flag("--force", a->force, "measure even where the alignment seems wrong");
    add_output_flag(*command, "--out", a->out, "JSON file for the scores, too");
    add_require(*command, a->require, "f1>=0.4");
    return {command, [a, command] {
                require_owner(*command, "--traj-threshold", !a->traj.empty(), "--traj FILE");
                require_owner(*command, "--palette", !a->results.empty(), "--results DIR");
                return tnt(*a);
            }};
}

}  // namespace tvsgs
