// tvsgs-eval nvs: measures how well a run renders its test views.
#include <memory>

#include "apps/eval/subcommands.h"
#include "core/device/device_choice.h"
#include "core/grouped.h"
#include "eval/image_metrics.h"
#include "io/files/json_value.h"
#include "pipeline/run/run_folder.h"
#include "pipeline/run/run_options.h"
#include "pipeline/run/view_evaluation.h"
#include "pipeline/scene/sky.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

struct NvsArguments {
    std::string model, scene, masks, device = "auto", quantize = "round", weights, range = "01";
    bool masked = false;
    std::vector<std::string> require;
};

/// Writes results.json and per_view.json in the format of 3DGS's metrics.py.
void write_metrics_files(const std::string& run,
                         const std::string& method,
                         const ViewScores& scores) {
    const auto named = [&](const JsonValue& psnr, const JsonValue& ssim, const JsonValue& lpips) {
        const JsonValue inner = JsonValue().add("SSIM", ssim).add("PSNR", psnr).add("LPIPS", lpips);
        return json_text(JsonValue().add(method, inner)) + "\n";
    };
    const auto column = [&](const char* key) {
        JsonValue values = JsonValue::object();
        for (const auto& [name, view] : scores.per_view.members) values.add(name, view[key]);
        return values;
    };
    write_text_file(run + "/results.json",
                    named(scores.mean.psnr, scores.mean.ssim, scores.mean.lpips));
    write_text_file(run + "/per_view.json", named(column("psnr"), column("ssim"), column("lpips")));
}

int nvs(const NvsArguments& arguments) {
    std::vector<std::string> keys = {"psnr", "ssim", "ssim_valid"};
    if (!arguments.weights.empty()) keys.emplace_back("lpips");
    std::vector<std::string> suffixes = {"_near", "_far"};
    if (arguments.masked) suffixes.emplace_back("_masked");
    const std::vector<std::string> of_all = keys;
    for (const std::string& suffix : suffixes)
        for (const std::string& key : of_all) keys.push_back(key + suffix);
    const std::vector<Bound> bounds = parse_bounds(arguments.require, keys);
    ViewScoring scoring;
    scoring.masked = arguments.masked;
    scoring.quantize = arguments.quantize == "round"   ? ViewScoring::Quantize::round
                       : arguments.quantize == "trunc" ? ViewScoring::Quantize::trunc
                                                       : ViewScoring::Quantize::none;
    scoring.lpips_range =
        arguments.range == "01" ? LpipsRange::zero_one : LpipsRange::minus_one_one;
    LpipsWeights weights;
    if (!arguments.weights.empty())
        weights = read_lpips_weights(arguments.weights), scoring.lpips = &weights;
    Configuration configuration;
    auto& [options, table] = configuration;
    table.read_file(run_config_path(arguments.model));
    if (!arguments.scene.empty()) options.scene.path = arguments.scene;
    // Otherwise the masks replace those of the run's configuration, which may be gone.
    if (!arguments.masks.empty() && !arguments.masked && options.scene.masks.empty())
        throw usage_error("--masks ", arguments.masks, ": needs --masked");
    if (!arguments.masks.empty()) options.scene.masks = arguments.masks;
    options.scene.need_points = false;
    const DeviceChoice device = choose_device(arguments.device);
    read_sky(options.train.loss.photometric, arguments.model);
    const std::string splat_path = find_splats(arguments.model);
    const Scene scene = read_scene_of_run(options.scene, arguments.model);
    const Gaussians<Cpu> splats = read_splats(splat_path, scene.origin, options.train);
    if (scene.test.empty())
        throw Error(ExitCode::input, arguments.model, ": no test views (scene ", options.scene.path,
                    "); train with --eval, --split or --test-list");
    spdlog::info("{}: {} splats, {} test views, on {}", splat_path, grouped(splats.size()),
                 scene.test.size(), device.description);

    const ViewScores scores = on_device(device, [&](auto tag) {
        Gaussians<decltype(tag)> gaussians;
        copy(splats, gaussians);
        return evaluate_views(gaussians, scene, options.train, arguments.model, scoring);
    });
    write_metrics_files(arguments.model, fs::path(splat_path).parent_path().filename().string(),
                        scores);
    scoring.trained = &scene.train;
    const JsonValue json = view_scores_json(scores, scene.test.size(), scoring);
    std::printf("%s\n", json_text(json).c_str());
    if (!scoring.lpips) spdlog::info("LPIPS: not computed; give its weights with --lpips-weights");
    spdlog::info("Renders, normal and depth maps: {}/test", arguments.model);
    result_of_run() = arguments.model + "/eval/nvs.json";
    return check_bounds(bounds, json);
}

}  // namespace

Subcommand add_eval_nvs(CLI::App& app) {
    const auto a = std::make_shared<NvsArguments>();
    CLI::App* command =
        app.add_subcommand("nvs", "measure PSNR, SSIM and LPIPS of the test views of a run");
    command->add_option("-m,--model,--model-path", a->model, "run folder")->required();
    command->add_option("-s,--scene", a->scene, "folder of the scene [that of the run]");
    command->add_option("--device", a->device, "auto, cpu, cuda or cuda:N");
    command->add_flag("--masked", a->masked,
                      "also score the object alone, inside its masks, on white");
    command->add_option("--masks", a->masks, "folder of the masks [those of the run]");
    add_choice(*command, "--quantize", a->quantize, {"round", "trunc", "none"},
               "rounding of renders to 8 bits: round, trunc or none [round]");
    command->add_option("--lpips-weights", a->weights,
                        "weights of VGG or AlexNet and of LPIPS (.safetensors, .npz) [no LPIPS]");
    add_choice(*command, "--lpips-range", a->range, {"01", "-11"},
               "range of colours: 01 as published with 3DGS, -11 as LPIPS defines it [01]");
    add_require(*command, a->require, "psnr>=20");
    return {command, [a, command] {
                require_owner(*command, "--lpips-range", !a->weights.empty(),
                              "--lpips-weights FILE");
                return nvs(*a);
            }};
}

}  // namespace tvsgs
