// tvsgs-eval geometry: measures distances between a prediction and the truth in one frame.
#include <memory>
#include <optional>

#include "apps/eval/subcommands.h"
#include "core/parse_numbers.h"
#include "core/scene/scene.h"
#include "eval/mesh_metrics.h"
#include "io/mesh/mesh_files.h"
#include "io/scene/crop_file.h"

namespace tvsgs {
namespace {

struct GeometryArguments {
    std::string pred, gt, visible_gt, taus, crop, out;
    double max_distance = 0;
    std::int64_t point_samples = 0;
    std::uint64_t seed = 0;
    std::vector<std::string> require;
};

/// Origin of a frame in which float is precise enough, also if the file is in UTM coordinates.
Vec3d origin_of(const std::string& path) {
    std::vector<Vec3d> positions = read_mesh_geometry(path).positions;
    std::erase_if(positions, [](Vec3d p) { return !is_finite(p); });
    return local_origin(positions);
}

int geometry(const GeometryArguments& arguments) {
    GeometryOptions options;
    if (!arguments.taus.empty()) options.taus = parse_numbers("--tau", arguments.taus);
    std::vector<std::string> keys = kDistanceKeys;
    for (const char* const name : {"precision@", "recall@", "f1@"}) {
        if (options.taus.empty()) keys.emplace_back(name);
        for (const double tau : options.taus) keys.push_back(str(name, tau));
    }
    const std::vector<Bound> bounds = parse_bounds(arguments.require, keys);
    options.max_distance = arguments.max_distance;
    const Crop crop = arguments.crop.empty() ? Crop{} : read_crop(arguments.crop);
    const MeasureOptions measure{arguments.point_samples, arguments.seed, arguments.crop,
                                 origin_of(arguments.gt)};
    const MeasuredSurface prediction = read_measured(arguments.pred, measure, crop),
                          truth = read_measured(arguments.gt, of_truth(measure), crop);
    std::optional<MeasuredSurface> visible;
    if (!arguments.visible_gt.empty())
        visible = read_measured(arguments.visible_gt, of_truth(measure), crop);
    const SamplePoints* const wanted = visible ? &visible->from : nullptr;
    const GeometryMetrics result = evaluate_geometry(prediction, truth, wanted, options);

    JsonValue json = geometry_json(result);
    JsonValue points = counts_json(prediction, truth, wanted);
    points.add("dropped_not_finite", prediction.dropped)
        .add("gt_dropped_not_finite", truth.dropped);
    if (visible) points.add("visible_gt_dropped_not_finite", visible->dropped);
    json.add("points", points);
    JsonValue inputs;
    inputs.add("pred", arguments.pred).add("gt", arguments.gt);
    if (!arguments.visible_gt.empty()) inputs.add("visible_gt", arguments.visible_gt);
    if (!arguments.crop.empty()) inputs.add("crop", arguments.crop);
    if (arguments.max_distance > 0) inputs.add("max_distance", arguments.max_distance);
    if (arguments.point_samples > 0) inputs.add("point_samples", arguments.point_samples);
    inputs.add("seed", arguments.seed);
    json.add("inputs", inputs);

    put_report(json, arguments.out);
    return check_bounds(bounds, json);
}

}  // namespace

Subcommand add_eval_geometry(CLI::App& app) {
    const auto a = std::make_shared<GeometryArguments>();
    CLI::App* command = app.add_subcommand(
        "geometry", "measure a surface or points against the truth, in its units");
    command->add_option("--pred", a->pred, "mesh (PLY, GLB, OBJ), cloud or splats (PLY)")
        ->required();
    command->add_option("--gt", a->gt, "true surface: mesh (PLY, GLB, OBJ) or cloud (PLY)")
        ->required();
    command->add_option("--visible-gt", a->visible_gt,
                        "part of the truth that the views see, for completeness and recall");
    command->add_option("--tau", a->taus,
                        "thresholds T,T,... of precision, recall and F1, in the truth's units");
    command
        ->add_option("--max-distance", a->max_distance,
                     "cap of distances, in the truth's units [none]")
        ->check(kPositive);
    command->add_option("--crop", a->crop,
                        "selection volume, {\"box\": ...} or gt/info.json of a scene [none]");
    add_number(*command, "--point-samples", a->point_samples, 1, 100000000,
               "N points on each mesh instead of its surface; biased, for older figures [surface]");
    command->add_option("--seed", a->seed, "seed of the samples [0]");
    add_output_flag(*command, "--out", a->out, "JSON file for the scores, too");
    add_require(*command, a->require, "chamfer<=2 or f1@1>=0.4");
    return {command, [a] { return geometry(*a); }};
}

}  // namespace tvsgs
