// tvsgs-eval: measures results. Writes JSON to standard output, messages to standard error.
#include <memory>

#include "apps/eval/subcommands.h"
#include "report/run_report.h"

namespace tvsgs {
namespace {

/// Logs the written file and how to view it.
void say_result(const std::string& file) {
    spdlog::info("Scores: {}", file);
    if (const std::string run = refresh_report(file); !run.empty())
        say_next({"tvsgs-view", run}, "look at it in a browser");
}

}  // namespace

Subcommand add_eval_report(CLI::App& app) {
    const auto run = std::make_shared<std::string>(), scene = std::make_shared<std::string>();
    CLI::App* command =
        app.add_subcommand("report", "write report.json and report.html of a run folder again");
    command->add_option("--run,-m,--model,--model-path", *run, "run folder")->required();
    command->add_option("-s,--scene", *scene, "folder of the scene [that of the run]");
    return {command, [run, scene] {
                make_report(*run, *scene);
                say_next({"tvsgs-view", *run}, "look at it in a browser");
                return 0;
            }};
}

int command(int argc, char** argv) {
    CLI::App app{"Measures meshes, splats and renders against the truth.", "tvsgs-eval"};
    app.footer(
        "Example, all that applies to a run and its true surface:\n"
        "  tvsgs-eval run --model RUN --gt SURFACE.ply");
    const int code = run_subcommand(
        app,
        {add_eval_geometry(app), add_eval_dtu(app), add_eval_tnt(app), add_eval_nvs(app),
         add_eval_run(app), add_eval_report(app), add_eval_table(app)},
        Verbosity::verbose, argc, argv);
    if (!result_of_run().empty()) say_result(result_of_run());
    return code;
}

}  // namespace tvsgs
