// tvsgs-eval: numbers out. Results go to standard output as JSON, messages to standard error.
#include <charconv>
#include <cmath>
#include <optional>

#include "common.h"
#include "io/atomic_file.h"
#include "io/config.h"
#include "io/crop_file.h"
#include "io/ply.h"
#include "mesh/mesh_metrics.h"
#include "run_folder.h"
#include "run_options.h"
#include "view_evaluation.h"

namespace tvsgs {
namespace {

/// A result that --require can ask for, by the name it has there.
struct Metric {
    std::string key;
    double value;
};

/// KEY<=X, KEY>=X, KEY<X or KEY>X.
struct Bound {
    std::string text, key, relation;
    double limit = 0;

    bool holds(double value) const {
        if (relation == "<=") return value <= limit;
        if (relation == ">=") return value >= limit;
        return relation == "<" ? value < limit : value > limit;
    }
};

Bound parse_bound(const std::string& text) {
    Bound bound{text, "", "", 0};
    const std::size_t at = text.find_first_of("<>");
    if (at != std::string::npos && at > 0) {
        const std::size_t length = at + 1 < text.size() && text[at + 1] == '=' ? 2 : 1;
        bound.key = text.substr(0, at);
        bound.relation = text.substr(at, length);
        bound.key.erase(bound.key.find_last_not_of(' ') + 1);
        const std::size_t number = text.find_first_not_of(' ', at + length);
        if (number != std::string::npos) {
            const auto [rest, code] =
                std::from_chars(text.data() + number, text.data() + text.size(), bound.limit);
            if (code == std::errc{} && rest == text.data() + text.size()) return bound;
        }
    }
    throw Error(ExitCode::usage,
                str("--require ", text,
                    ": expected KEY<=X or KEY>=X, for example chamfer<=2 or f1@1>=0.4"));
}

/// Keys with a threshold, as f1@1, compare it as a number: f1@1.0 is the same.
bool same_key(const std::string& a, const std::string& b) {
    const auto split = [](const std::string& key) {
        const std::size_t at = key.find('@');
        double tau = std::nan("");
        if (at != std::string::npos)
            std::from_chars(key.data() + at + 1, key.data() + key.size(), tau);
        return std::pair{key.substr(0, at), tau};
    };
    const auto [name_a, tau_a] = split(a);
    const auto [name_b, tau_b] = split(b);
    return a == b || (name_a == name_b && tau_a == tau_b);
}

/// Exit code: that of an unmet bound when one of `bounds` does not hold.
int check_bounds(const std::vector<Bound>& bounds, const std::vector<Metric>& metrics) {
    bool met = true;
    for (const Bound& bound : bounds) {
        const auto metric = std::find_if(metrics.begin(), metrics.end(), [&](const Metric& m) {
            return same_key(m.key, bound.key);
        });
        if (metric == metrics.end()) {
            std::string known;
            for (const Metric& m : metrics) known += (known.empty() ? "" : ", ") + m.key;
            throw Error(ExitCode::usage, str("--require ", bound.text, ": there is no '", bound.key,
                                             "'; there are ", known));
        }
        if (bound.holds(metric->value)) continue;
        spdlog::error("required {}, but {} is {:.6g}", bound.text, bound.key, metric->value);
        met = false;
    }
    return static_cast<int>(met ? ExitCode::done : ExitCode::bound);
}

std::vector<double> parse_numbers(const std::string& flag, const std::string& text) {
    std::vector<double> numbers;
    const char* at = text.data();
    const char* const end = at + text.size();
    while (at <= end) {
        double value = 0;
        const auto [rest, code] = std::from_chars(at, end, value);
        if (code != std::errc{} || !(value > 0 && std::isfinite(value)) ||
            (rest != end && *rest != ','))
            throw Error(ExitCode::usage,
                        str(flag, " ", text, ": expected positive numbers with commas between"));
        numbers.push_back(value);
        at = rest + 1;
    }
    return numbers;
}

struct GeometryArguments {
    std::string pred, gt, visible_gt, taus, crop, out;
    double max_distance = 0;
    std::int64_t samples = 1000000;
    std::uint64_t seed = 0;
    std::vector<std::string> require;
};

/// Points to measure from: even samples of a mesh, the points of a cloud, the centres of splats;
/// those in the crop.
std::vector<Vec3f> read_points(const std::string& path,
                               const GeometryArguments& arguments,
                               const Crop& crop) {
    PlyContents ply = read_ply(path);
    const char* kind = ply.is_splats       ? "splat centres"
                       : ply.faces.empty() ? "points"
                                           : "samples of the mesh";
    std::vector<Vec3f> points;
    if (ply.faces.empty()) {
        points = std::move(ply.points.positions);
    } else {
        const TriangleMesh mesh{std::move(ply.points.positions), {}, std::move(ply.faces)};
        points = with_context("reading " + path, [&] {
            return sample_surface(mesh, static_cast<std::size_t>(arguments.samples),
                                  arguments.seed);
        });
    }
    const std::size_t before = points.size();
    Vec3d lower{INFINITY, INFINITY, INFINITY}, upper = -lower;
    std::erase_if(points, [&](Vec3f p) {
        if (!is_finite(p)) return true;
        for (int axis = 0; axis < 3; ++axis) {
            lower[axis] = std::min<double>(lower[axis], p[axis]);
            upper[axis] = std::max<double>(upper[axis], p[axis]);
        }
        return !contains(crop, vec_cast<double>(p));
    });
    spdlog::info("{}: {} {}, {} of them used", path, before, kind, points.size());
    if (points.empty())
        throw Error(
            ExitCode::input,
            before == 0 ? str(path, ": holds no points; nothing to compare")
            : !(lower.x <= upper.x)
                ? str(path, ": none of its ", before, " ", kind, " is finite")
                : str(path, ": none of its ", before, " ", kind, " is inside of ", arguments.crop,
                      "; they span (", lower.x, ", ", lower.y, ", ", lower.z, ") to (", upper.x,
                      ", ", upper.y, ", ", upper.z, "); are frame and units those of the crop?"));
    return points;
}

int geometry(const GeometryArguments& arguments) {
    std::vector<Bound> bounds;
    for (const std::string& text : arguments.require) bounds.push_back(parse_bound(text));
    GeometryOptions options;
    if (!arguments.taus.empty()) options.taus = parse_numbers("--tau", arguments.taus);
    options.max_distance = arguments.max_distance;
    const Crop crop = arguments.crop.empty() ? Crop{} : read_crop(arguments.crop);
    const std::vector<Vec3f> prediction = read_points(arguments.pred, arguments, crop);
    const std::vector<Vec3f> truth = read_points(arguments.gt, arguments, crop);
    std::vector<Vec3f> visible;
    if (!arguments.visible_gt.empty()) visible = read_points(arguments.visible_gt, arguments, crop);
    const GeometryMetrics result = evaluate_geometry(prediction, truth, visible, options);

    std::vector<Metric> metrics = {{"accuracy", result.accuracy},
                                   {"completeness", result.completeness},
                                   {"chamfer", result.chamfer},
                                   {"median_accuracy", result.median_accuracy},
                                   {"median_completeness", result.median_completeness}};
    JsonLine json;
    for (const Metric& metric : metrics) json.add(metric.key, metric.value);
    std::string thresholds;
    for (const auto& t : result.thresholds) {
        const std::vector<Metric> at_tau = {
            {"precision", t.precision}, {"recall", t.recall}, {"f1", t.f1}};
        JsonLine line;
        line.add("tau", t.tau);
        for (const Metric& metric : at_tau) {
            line.add(metric.key, metric.value);
            metrics.push_back({str(metric.key, "@", t.tau), metric.value});
        }
        thresholds += (thresholds.empty() ? "" : ", ") + line.text();
    }
    json.add_json("thresholds", "[" + thresholds + "]");
    JsonLine counts;
    counts.add("pred", static_cast<std::int64_t>(prediction.size()))
        .add("gt", static_cast<std::int64_t>(truth.size()));
    if (!visible.empty()) counts.add("visible_gt", static_cast<std::int64_t>(visible.size()));
    json.add_json("points", counts.text());
    JsonLine inputs;
    inputs.add("pred", arguments.pred).add("gt", arguments.gt);
    if (!arguments.visible_gt.empty()) inputs.add("visible_gt", arguments.visible_gt);
    if (!arguments.crop.empty()) inputs.add("crop", arguments.crop);
    if (arguments.max_distance > 0) inputs.add("max_distance", arguments.max_distance);
    inputs.add("samples", arguments.samples).add("seed", static_cast<std::int64_t>(arguments.seed));
    json.add_json("inputs", inputs.text());

    std::printf("%s\n", json.text().c_str());
    if (!arguments.out.empty()) write_text_file(arguments.out, json.text() + "\n");
    return check_bounds(bounds, metrics);
}

struct NvsArguments {
    std::string model, scene, device = "auto";
    std::vector<std::string> require;
};

int nvs(const NvsArguments& arguments) {
    std::vector<Bound> bounds;
    for (const std::string& text : arguments.require) bounds.push_back(parse_bound(text));
    RunOptions options;
    OptionTable table;
    options.add_to(table);
    table.read_file(run_config_path(arguments.model));
    if (!arguments.scene.empty()) options.scene.path = arguments.scene;
    options.scene.need_points = false;
    const DeviceChoice device = choose_device(arguments.device);
    const std::string splat_path = find_splats(arguments.model);
    const Gaussians<Cpu> splats = read_splats(splat_path);
    const Scene scene = read_scene_of_run(options.scene, arguments.model);
    if (scene.test.empty())
        throw Error(ExitCode::input,
                    str(arguments.model, ": the run has no test views (scene ", options.scene.path,
                        "); train with --split, --test-list or --eval to have some"));
    spdlog::info("{}: {} splats, {} test views, on {}", splat_path, splats.size(),
                 scene.test.size(), device.description);

    const ViewScores scores = on_device(device, [&](auto tag) {
        Gaussians<decltype(tag)> gaussians;
        copy(splats, gaussians);
        return evaluate_views(gaussians, scene.test, options.train, arguments.model);
    });
    JsonLine json;
    json.add("psnr", scores.mean_psnr)
        .add("ssim", scores.mean_ssim)
        .add("views", static_cast<int>(scene.test.size()));
    std::printf("%s\n", json.text().c_str());
    spdlog::info("per view: {}/eval/nvs.json; renders, normal and depth maps: {}/test",
                 arguments.model, arguments.model);
    return check_bounds(bounds, {{"psnr", scores.mean_psnr}, {"ssim", scores.mean_ssim}});
}

int command(int argc, char** argv) {
    GeometryArguments geometry_arguments;
    NvsArguments nvs_arguments;
    bool quiet = false;
    CLI::App app{"Measures results.", "tvsgs-eval"};
    app.require_subcommand(1);
    app.set_version_flag("--version", kVersion);

    CLI::App* geometry_command =
        app.add_subcommand("geometry", "surface or points against the truth, in the truth's units");
    {
        GeometryArguments& a = geometry_arguments;
        geometry_command->add_option("--pred", a.pred, "mesh, cloud or splats (PLY)")->required();
        geometry_command->add_option("--gt", a.gt, "mesh or cloud (PLY)")->required();
        geometry_command->add_option("--visible-gt", a.visible_gt,
                                     "part of the truth that completeness and recall ask for");
        geometry_command->add_option("--tau", a.taus,
                                     "thresholds T,T,... of precision, recall and F1");
        geometry_command->add_option("--max-distance", a.max_distance, "distances are capped there")
            ->check(kPositive);
        geometry_command->add_option("--crop", a.crop,
                                     "selection volume, {\"box\": ...} or a scene's gt/info.json");
        geometry_command->add_option("--samples", a.samples, "points on a mesh [1000000]")
            ->check(CLI::Range(1, 100000000));
        geometry_command->add_option("--seed", a.seed, "of the samples [0]");
        geometry_command->add_option("--out", a.out, "JSON file to write as well");
        geometry_command
            ->add_option("--require", a.require,
                         "KEY<=X or KEY>=X, as chamfer<=2 or f1@1>=0.4; else exit code 8")
            ->expected(1)
            ->take_all();
        geometry_command->add_flag("--quiet", quiet, "warnings and errors only");
    }
    CLI::App* nvs_command = app.add_subcommand("nvs", "PSNR and SSIM of a run's test views");
    {
        NvsArguments& a = nvs_arguments;
        nvs_command->add_option("-m,--model,--model-path", a.model, "run folder")->required();
        nvs_command->add_option("-s,--scene", a.scene, "folder of the scene [that of the run]");
        nvs_command->add_option("--device", a.device, "auto, cpu, cuda or cuda:N");
        nvs_command->add_option("--require", a.require, "psnr>=X or ssim>=X; else exit code 8")
            ->expected(1)
            ->take_all();
        nvs_command->add_flag("--quiet", quiet, "warnings and errors only");
    }
    parse_command_line(app, argc, argv);
    init_log(quiet ? Verbosity::quiet : Verbosity::normal);
    return geometry_command->parsed() ? geometry(geometry_arguments) : nvs(nvs_arguments);
}

}  // namespace
}  // namespace tvsgs

int main(int argc, char** argv) {
    return tvsgs::run_command([&] { return tvsgs::command(argc, argv); });
}
