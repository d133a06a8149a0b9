// tvsgs-eval dtu: the official DTU evaluation. docs/guide/evaluation.md
#include <memory>
#include <optional>

#include "apps/eval/subcommands.h"
#include "eval/benchmark_files.h"
#include "eval/dtu_files.h"
#include "eval/protocols.h"
#include "io/files/manifest.h"
#include "io/files/read_file.h"
#include "io/scene/scene_layout.h"

namespace tvsgs {
namespace {

struct DtuArguments {
    std::string pred, dtu, cameras, units = "auto", mode = "auto", order = "seeded", clouds,
                                    palette, out;
    int scan = 0;
    DtuCulling cull;
    double min_opacity = 0;
    std::uint64_t seed = 0;
    bool force = false;
    DtuOptions options;
    std::vector<std::string> require;
};

JsonValue counts_json(const Prediction& in, std::size_t culled, const DtuMetrics& m) {
    JsonValue json;
    json.add("vertices", in.vertices)
        .add("faces", in.faces)
        .add("dropped_not_finite", in.dropped)
        .add("dropped_transparent", in.transparent)
        .add("culled", culled)
        .add("sampled", m.sampled)
        .add("thinned", m.thinned)
        .add("in_box", m.in_box)
        .add("observed", m.observed)
        .add("accuracy_outliers", m.accuracy_outliers)
        .add("gt", m.truth)
        .add("gt_above_plane", m.truth_above)
        .add("completeness_outliers", m.completeness_outliers);
    return json;
}

int dtu(const DtuArguments& a) {
    const std::vector<Bound> bounds = parse_bounds(a.require, kDistanceKeys);
    if (!a.clouds.empty()) create_results_folder(a.clouds, {"accuracy.ply", "completeness.ply"});
    DtuOptions options = a.options;
    if (a.order == "given")
        options.seed.reset();
    else
        options.seed = a.seed;

    // 1. Read, convert to millimetres, cull.
    const DtuTruth truth = read_dtu_truth(a.dtu, a.scan);
    Prediction in = read_prediction(a.pred, a.min_opacity);
    const std::string camera_file = find_dtu_cameras(a.cameras, a.cull.masks);
    std::optional<NpzCameras> cameras;
    if (!camera_file.empty()) cameras = read_npz_cameras(camera_file);
    const bool normalised = to_millimetres(in.mesh, cameras ? &*cameras : nullptr, a.units);
    if (const FrameCheck frame = check_frame(in.mesh.vertices, truth.points);
        !frame.plausible() && !a.force)
        throw input_error("E_DTU_FRAME: ", a.pred, " is not in the frame of scan ", a.scan, ": ",
                          frame.text(),
                          "; was scale_mat applied twice or not at all? Try --cameras FILE "
                          "--mesh-units normalised, or --force to measure anyway");
    const bool culling = !a.cull.masks.empty() && a.cull.views != "none";
    const std::size_t culled = culling ? cull_dtu(in.mesh, *cameras, a.cull) : 0;

    // 2. Measure.
    bool sample = a.mode != "points" && !in.is_splats;
    if (sample && in.mesh.faces.empty()) {
        if (a.mode == "mesh" || in.faces > 0)
            spdlog::warn("{}: no faces; the vertices are measured as points", a.pred);
        sample = false;
    }
    DtuMetrics m = evaluate_dtu(
        sample ? sample_dtu(in.mesh.vertices, in.mesh.faces, options) : in.mesh.vertices, truth,
        options);

    // 3. Report.
    JsonValue protocol;
    protocol.add("measured", sample         ? "mesh"
                             : in.is_splats ? "splat centres"
                                            : "points")
        .add("spacing", options.spacing)
        .add("max_distance", options.max_distance)
        .add("order", a.order);
    if (options.seed) protocol.add("seed", *options.seed);
    protocol.add("units", normalised ? "normalised, scaled by scale_mat_0" : "mm")
        .add("cull", culling ? a.cull.views : "none");
    if (culling) protocol.add("cull_dilate_px", a.cull.dilate_px);
    if (in.is_splats) protocol.add("min_opacity", a.min_opacity);
    JsonValue inputs;
    inputs.add("pred", a.pred).add("dtu", a.dtu).add("scan", a.scan);
    if (cameras) inputs.add("cameras", camera_file);
    if (culling) inputs.add("masks", a.cull.masks);
    JsonValue json;
    json.add("accuracy", m.accuracy)
        .add("completeness", m.completeness)
        .add("chamfer", m.overall)
        .add("median_accuracy", m.accuracy_median)
        .add("median_completeness", m.completeness_median)
        .add("points", counts_json(in, culled, m))
        .add("protocol", protocol)
        .add("inputs", inputs);
    put_report(json, a.out);
    if (!m.undefined.empty())
        throw input_error("E_DTU_EMPTY: scan ", a.scan, ": ", m.undefined,
                          "; nothing can be measured");
    if (!a.clouds.empty()) {
        constexpr double kFull = 10;  // mm, as in the official pictures
        const ErrorPalette palette = find_palette(a.palette, ErrorPalette::dtu);
        write_error_cloud(a.clouds + "/accuracy.ply", m.prediction, palette, kFull);
        write_error_cloud(a.clouds + "/completeness.ply", m.reference, palette, kFull);
    }
    return check_bounds(bounds, json);
}

}  // namespace

Subcommand add_eval_dtu(CLI::App& app) {
    const auto a = std::make_shared<DtuArguments>();
    CLI::App* command = app.add_subcommand("dtu", "measure as the DTU benchmark does, in mm");
    command->add_option("--pred", a->pred, "mesh, cloud or splats (PLY)")->required();
    command->add_option("--scan", a->scan, "number of the scan")
        ->required()
        ->check(CLI::Range(1, 9999));
    command->add_option("--dtu", a->dtu, "folder with Points/ and ObsMask/")->required();
    command->add_option("--cameras", a->cameras, "cameras.npz with scale_mat_0 [beside the masks]");
    add_choice(*command, "--mesh-units", a->units, {"auto", "mm", "normalised"},
               "units of the prediction: auto, mm or normalised [auto]");
    add_choice(*command, "--mode", a->mode, {"auto", "mesh", "points"},
               "what the file is: auto, mesh or points [auto]");
    command->add_option("--cull-masks", a->cull.masks,
                        "folder of the object masks that cull the prediction [no culling]");
    command->add_option("--cull", a->cull.views,
                        "views whose masks cull: all, first:N, none or I,J,K [all]");
    add_number(*command, "--cull-dilate", a->cull.dilate_px, 0, 200,
               "pixels by which the masks grow [24]");
    add_number(*command, "--min-opacity", a->min_opacity, 0.0, 1.0,
               "skip splats below this opacity [0: none]");
    command->add_option("--seed", a->seed, "seed of the order of thinning [0]");
    add_choice(*command, "--order", a->order, {"seeded", "given"},
               "order of thinning: seeded or given [seeded]");
    command
        ->add_option("--spacing", a->options.spacing,
                     "distance of samples, also after thinning, mm [0.2]")
        ->check(kPositive);
    command
        ->add_option("--max-distance", a->options.max_distance,
                     "larger distances are outliers, mm [20]")
        ->check(kPositive);
    command->add_option("--clouds", a->clouds, "folder for clouds coloured by error [none]");
    add_choice(*command, "--palette", a->palette, {"dtu", "tnt", "safe"},
               "colours of the clouds: dtu, tnt or safe (colour-blind) [dtu]");
    command->add_flag("--force", a->force, "measure even where the frames seem to differ");
    add_output_flag(*command, "--out", a->out, "JSON file for the scores, too");
    add_require(*command, a->require, "chamfer<=1.5");
    return {command, [a, command] {
                const bool masks = !a->cull.masks.empty();
                require_owner(*command, "--cull", masks || a->cull.views == "none",
                              "--cull-masks DIR");
                require_owner(*command, "--cull-dilate", masks, "--cull-masks DIR");
                require_owner(*command, "--seed", a->order == "seeded", "--order seeded");
                require_owner(*command, "--palette", !a->clouds.empty(), "--clouds DIR");
                return dtu(*a);
            }};
}

}  // namespace tvsgs
