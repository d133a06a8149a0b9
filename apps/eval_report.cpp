// tvsgs-eval report: report.json and report.html of a run, made again from its folder.
#include <memory>

#include "eval.h"
#include "report_data.h"
#include "run_folder.h"
#include "run_options.h"

namespace tvsgs {
namespace {

/// The report of a run that has moved away from its scene does without what it lacks.
template <class Action>
void if_possible(const char* lacking, Action&& action) {
    try {
        action();
    } catch (const Error& error) {
        spdlog::warn("{}; the report does without {}", error.what(), lacking);
    }
}

int report(const std::string& run, const std::string& scene_path) {
    RunOptions options;
    OptionTable table;
    options.add_to(table);
    table.read_file(run_config_path(run));
    if (!scene_path.empty()) options.scene.path = scene_path;
    options.scene.need_points = false;
    std::vector<View> test;
    std::optional<Truth> truth;
    Vec3d origin;
    if_possible("photographs", [&] {
        Scene scene = read_scene_of_run(options.scene, run);
        test = std::move(scene.test), origin = scene.origin;
    });
    if_possible("errors of the centres", [&] { truth = read_truth(options.eval, origin); });
    write_report(run, test, truth, origin);
    spdlog::info("{}/report.html", run);
    return 0;
}

}  // namespace

EvalCommand add_eval_report(CLI::App& app) {
    struct Arguments {
        std::string run, scene;
    };
    const auto arguments = std::make_shared<Arguments>();
    CLI::App* command =
        app.add_subcommand("report", "report.json and report.html of a run folder, anew");
    command->add_option("--run,-m,--model,--model-path", arguments->run, "run folder")->required();
    command->add_option("-s,--scene", arguments->scene, "folder of the scene [that of the run]");
    return {command, [arguments] { return report(arguments->run, arguments->scene); }};
}

}  // namespace tvsgs
