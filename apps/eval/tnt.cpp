// tvsgs-eval tnt: the evaluation of Tanks and Temples. docs/guide/evaluation.md
#include <cmath>
#include <memory>

#include "apps/eval/subcommands.h"
#include "core/grouped.h"
#include "eval/tnt_files.h"
#include "eval/tnt_protocol.h"
#include "io/files/atomic_file.h"
#include "io/files/manifest.h"
#include "io/files/read_file.h"
#include "io/scene/crop_file.h"
#include "io/scene/trajectory.h"

namespace tvsgs {
namespace {

struct TntArguments {
    std::string pred, scene_dir, scene_name, traj, align_file, points = "auto", results, palette,
                                                               out;
    double tau = 0, traj_threshold = 0.2, min_opacity = 0;
    std::uint64_t seed = 0;
    bool no_icp = false, icp_intended = false, force = false;
    std::vector<std::string> require;
};

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
    const TntFiles files = find_tnt_files(a.scene_dir, a.scene_name);
    const double tau = find_tnt_tau(a.tau, files.scene);
    if (!a.results.empty())
        create_results_folder(a.results,
                              {"alignment.txt", files.scene + ".precision.txt",
                               files.scene + ".recall.txt", files.scene + ".prf_tau_plotstr.txt",
                               files.scene + ".precision.ply", files.scene + ".recall.ply"});

    // 1. Read.
    const Crop crop = read_crop(files.crop);
    const std::vector<Vec3d> truth = read_truth(files.cloud, kTntDistribution);
    const std::vector<Vec3d> truth_cropped = cropped(truth, crop);
    if (truth_cropped.empty())
        throw input_error("E_CROP: ", files.crop, ": none of the ", grouped(truth.size()),
                          " points of the truth is inside; is it the crop volume of this scene?");
    const Prediction in = read_prediction(a.pred, a.min_opacity);
    std::string used;
    const std::vector<Vec3d> points = choose_tnt_points(in, a.points, a.seed, used);

    // 2. Align.
    TntAlignment alignment;
    if (!a.align_file.empty()) {
        alignment.start = read_transform(a.align_file);
        alignment.how = a.align_file;
    } else {
        align_by_cameras(a.traj, files, a.traj_threshold, a.seed, a.force, alignment);
    }
    alignment.final = alignment.start;
    if (!a.force)
        check_tnt_overlap(transformed(points, alignment.start), truth_cropped, crop, a.pred);
    const bool icp = !a.no_icp && a.align_file.empty();
    if (icp) refine_tnt(points, truth_cropped, crop, tau, a.icp_intended, alignment);

    // 3. Measure and report.
    const TntMetrics m =
        evaluate_tnt(transformed(points, alignment.final), truth_cropped, crop, tau, tau / 2);
    const std::vector<Metric> metrics = {
        {"precision", m.precision}, {"recall", m.recall}, {"f1", m.f1}};
    JsonValue json, counts, inputs;
    json.add("scene", files.scene);
    for (const Metric& metric : metrics)
        json.add(metric.key, m.undefined.empty() ? metric.value : std::nan(""));
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
    return check_bounds(bounds, metrics);
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
