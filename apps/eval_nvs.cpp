// tvsgs-eval nvs: how well a run renders its test views.
#include <memory>

#include "eval.h"
#include "io/config.h"
#include "run_folder.h"
#include "run_options.h"
#include "view_evaluation.h"

namespace tvsgs {
namespace {

struct NvsArguments {
    std::string model, scene, device = "auto";
    std::vector<std::string> require;
};

int nvs(const NvsArguments& arguments) {
    const std::vector<Bound> bounds = parse_bounds(arguments.require);
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

}  // namespace

EvalCommand add_eval_nvs(CLI::App& app) {
    const auto arguments = std::make_shared<NvsArguments>();
    NvsArguments& a = *arguments;
    CLI::App* command = app.add_subcommand("nvs", "PSNR and SSIM of a run's test views");
    command->add_option("-m,--model,--model-path", a.model, "run folder")->required();
    command->add_option("-s,--scene", a.scene, "folder of the scene [that of the run]");
    command->add_option("--device", a.device, "auto, cpu, cuda or cuda:N");
    add_require(*command, a.require, "psnr>=20");
    return {command, [arguments] { return nvs(*arguments); }};
}

}  // namespace tvsgs
