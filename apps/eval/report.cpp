// tvsgs-eval report: writes report.json and report.html of a run again from its folder.
#include <memory>

#include "apps/eval/subcommands.h"
#include "report/run_report.h"

namespace tvsgs {

EvalCommand add_eval_report(CLI::App& app) {
    struct Arguments {
        std::string run, scene;
    };
    const auto arguments = std::make_shared<Arguments>();
    CLI::App* command =
        app.add_subcommand("report", "write report.json and report.html of a run folder again");
    command->add_option("--run,-m,--model,--model-path", arguments->run, "run folder")->required();
    command->add_option("-s,--scene", arguments->scene, "folder of the scene [that of the run]");
    return {command, [arguments] {
                make_report(arguments->run, arguments->scene);
                say_next({"tvsgs-view", arguments->run}, "look at it in a browser");
                return 0;
            }};
}

}  // namespace tvsgs
