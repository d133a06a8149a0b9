#include "eval/tnt_files.h"

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <string_view>

#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"
#include "eval/geometry_scores.h"
#include "io/files/atomic_file.h"
#include "io/files/read_file.h"
#include "io/scene/trajectory.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

Vec3d mean_of(const Points& points) {
    Vec3d sum{};
    for (const Vec3d p : points) sum += p;
    return sum / static_cast<double>(points.size());
}

std::string lines(const std::vector<double>& values) {
    std::string text;
    char line[40];
    for (const double v : values) {
        std::snprintf(line, sizeof line, "%.18e\n", v);  // as numpy.savetxt
        text += line;
    }
    return text;
}

constexpr double kLeft = 60, kTop = 40, kWidth = 400, kHeight = 300;  // plot area, px

/// Draws the fractions over the thresholds.
std::string polyline(const std::vector<double>& edges,
                     const std::vector<double>& values,
                     const char* style) {
    std::string points;
    char point[40];
    for (std::size_t i = 0; i < values.size(); ++i) {
        std::snprintf(point, sizeof point, "%.1f,%.1f ",
                      kLeft + kWidth * edges[i + 1] / edges.back(),
                      kTop + kHeight * (1 - values[i]));
        points += point;
    }
    return str("<polyline fill=\"none\" stroke-width=\"2\" ", style, " points=\"", points,
               "\"/>\n");
}

std::string svg(const std::string& scene, const TntMetrics& m, double tau) {
    char title[200];
    std::snprintf(title, sizeof title, "P %.4f, R %.4f, F1 %.4f at %g", m.precision, m.recall, m.f1,
                  tau);
    std::string safe;  // the name without characters of XML
    for (const char c : scene) safe += c == '<' || c == '&' || c == '>' ? '_' : c;
    std::string text =
        str("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 500 400\" "
            "font-family=\"sans-serif\" "
            "font-size=\"12\">\n<title>",
            safe, ": precision and recall</title>\n<desc>", title,
            "</desc>\n<rect width=\"500\" height=\"400\" fill=\"white\"/>\n<text x=\"", kLeft,
            "\" y=\"24\" font-size=\"14\">", safe, ": ", title, "</text>\n");
    for (int i = 0; i <= 5; ++i) {
        const double x = kLeft + kWidth * i / 5, y = kTop + kHeight * (5 - i) / 5;
        text += str("<path d=\"M", kLeft, " ", y, "h", kWidth, "\" stroke=\"#ddd\"/><text x=\"",
                    kLeft - 8, "\" y=\"", y + 4, "\" text-anchor=\"end\">", 20 * i,
                    " %</text><text x=\"", x, "\" y=\"", kTop + kHeight + 18,
                    "\" text-anchor=\"middle\">", i * tau, "</text>\n");
    }
    const double at = kLeft + kWidth / 5;
    text += str("<path d=\"M", at, " ", kTop, "v", kHeight,
                "\" stroke=\"#555\" stroke-dasharray=\"4\"/>\n",
                polyline(m.edges, m.precision_curve, "stroke=\"#0072b2\""),
                polyline(m.edges, m.recall_curve, "stroke=\"#d55e00\" stroke-dasharray=\"6 3\""));
    return text + str("<text x=\"", kLeft, "\" y=\"", kTop + kHeight + 38,
                      "\" fill=\"#0072b2\">precision (solid)</text>\n<text x=\"", kLeft + 130,
                      "\" y=\"", kTop + kHeight + 38,
                      "\" fill=\"#b24f00\">recall (dashed)</text>\n<text x=\"", kLeft + kWidth,
                      "\" y=\"", kTop + kHeight + 38,
                      "\" text-anchor=\"end\">distance</text>\n</svg>\n");
}

}  // namespace

const char* const kTntDistribution =
    "  expected DIR/<Scene>.ply, DIR/<Scene>.json, DIR/<Scene>_COLMAP_SfM.log and "
    "DIR/<Scene>_trans.txt;\n  they come with the training set of the benchmark: "
    "https://www.tanksandtemples.org/download/";

TntFiles find_tnt_files(const std::string& scene_dir, const std::string& scene_name) {
    const fs::path folder(scene_dir);
    std::error_code error;
    if (!fs::is_directory(folder, error))
        throw input_error(scene_dir, ": folder not found\n", kTntDistribution);
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
                              kTntDistribution);
        scene = found[0];
    }
    const auto file = [&](const std::string& end) { return (folder / (scene + end)).string(); };
    TntFiles files{scene, file(".ply"), file(".json"), file(std::string(kLog)), file("_trans.txt")};
    for (const std::string& path : {files.cloud, files.crop, files.log, files.trans})
        require_file(path, kTntDistribution);
    return files;
}

// [TanksAndTemples: config.py], metres
double find_tnt_tau(double given, const std::string& scene) {
    if (given > 0) return given;
    const std::map<std::string, double> taus = {
        {"Barn", 0.01},      {"Caterpillar", 0.005}, {"Church", 0.025}, {"Courthouse", 0.025},
        {"Ignatius", 0.003}, {"Meetingroom", 0.01},  {"Truck", 0.005}};
    if (const auto tau = taus.find(scene); tau != taus.end()) return tau->second;
    throw Error(
        ExitCode::usage,
        str("scene ", scene, ": no known threshold; give --tau, in the units of the truth"));
}

void align_by_cameras(const std::string& trajectory,
                      const TntFiles& files,
                      double threshold,
                      std::uint64_t seed,
                      bool force,
                      TntAlignment& out) {
    const Affine3d truth_from_log = read_transform(files.trans);
    if (trajectory.empty() ||
        (!fs::is_directory(trajectory) && read_bytes(trajectory) == read_bytes(files.log))) {
        out.start = truth_from_log;
        out.how = "the frame of the official log";
        return;
    }
    CentrePairs pairs = pair_trajectories(trajectory, files.log);
    for (Vec3d& p : pairs.to) p = truth_from_log * p;
    const CentreAlignment fit = align_centres(pairs.from, pairs.to, threshold, seed);
    out.start = fit.to_from_from;
    out.how = "camera centres of " + trajectory;
    out.json.add("poses", pairs.poses)
        .add("log_poses", pairs.log_poses)
        .add("matched_by", pairs.matched_by)
        .add("pairs", pairs.from.size())
        .add("inliers", fit.inliers)
        .add("inlier_rmse", fit.rmse)
        .add("median_residual", fit.median_residual);
    spdlog::info("{} of {} camera centres agree within {}; median error {:.4g}", fit.inliers,
                 pairs.from.size(), threshold, fit.median_residual);
    if (2 * static_cast<std::size_t>(fit.inliers) < pairs.from.size() && !force)
        throw input_error(
            "E_TNT_TRAJ_RESIDUAL: ", trajectory, ": only ", fit.inliers, " of ", pairs.from.size(),
            " camera centres are within ", threshold, " of those in ", files.log, " (median error ",
            fit.median_residual,
            "); is the trajectory of another reconstruction? --force measures anyway");
}

void refine_tnt(const Points& points,
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
    const MotionDifference moved = difference(out.final, out.start, mean_of(truth_cropped));
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

Points choose_tnt_points(const Prediction& in,
                         const std::string& choice,
                         std::uint64_t seed,
                         std::string& used) {
    const PreciseMesh& mesh = in.mesh;
    used = choice != "auto" ? choice : mesh.faces.empty() ? "vertices" : "vertices+centroids";
    if (in.is_splats) used = "splat centres";
    if (used.starts_with("area:")) {
        int count = 0;
        if (!parse_number(std::string_view(used).substr(5), count) || count < 1)
            throw Error(ExitCode::usage,
                        str("--points ", used, ": expected area:N with N above 0"));
        TriangleMesh single{{}, {}, mesh.faces};
        for (const Vec3d p : mesh.vertices) single.vertices.push_back(vec_cast<float>(p));
        Points points;
        for (const Vec3f p : sample_surface(single, static_cast<std::size_t>(count), seed))
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
        throw Error(ExitCode::usage, str("--points ", used,
                                         ": expected auto, vertices, vertices+centroids or "
                                         "area:N"));
    return points;
}

void check_tnt_overlap(const Points& moved,
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

void write_curves(const std::string& folder,
                  const std::string& scene,
                  const TntMetrics& m,
                  double tau) {
    const std::string stem = folder + "/" + scene;
    write_text_file(stem + ".precision.txt", lines(m.precision_curve));
    write_text_file(stem + ".recall.txt", lines(m.recall_curve));
    write_text_file(stem + ".prf_tau_plotstr.txt", lines({m.precision, m.recall, m.f1, tau, 5}));
    char number[16];
    std::snprintf(number, sizeof number, "%04ld", std::lround(10000 * tau));
    write_text_file(str(folder, "/PR_", scene, "_@d_th_0_", number, ".svg"), svg(scene, m, tau));
}

}  // namespace tvsgs
