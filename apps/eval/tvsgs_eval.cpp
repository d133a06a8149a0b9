// tvsgs-eval: measures results. Writes JSON to standard output, messages to standard error.
#include "apps/eval/result.h"
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

int command(int argc, char** argv) {
    bool quiet = false, verbose = false;
    CLI::App app{"Measures meshes, splats and renders against the truth.", "tvsgs-eval"};
    app.footer(
        "Example, all that applies to a run and its true surface:\n"
        "  tvsgs-eval run --model RUN --gt SURFACE.ply");
    app.require_subcommand(1);
    const EvalCommand commands[] = {add_eval_geometry(app), add_eval_dtu(app), add_eval_tnt(app),
                                    add_eval_nvs(app),      add_eval_run(app), add_eval_report(app),
                                    add_eval_table(app)};
    for (const EvalCommand& c : commands) {
        CLI::Option* const flag = c.command->add_flag("--quiet", quiet, "warnings and errors only");
        c.command->add_flag("-v,--verbose", verbose, "more detail")->excludes(flag);
    }
    parse_command_line(app, argc, argv);
    init_log(quiet ? Verbosity::quiet : verbose ? Verbosity::verbose : Verbosity::normal);
    for (const EvalCommand& c : commands)
        if (c.command->parsed()) {
            const int code = c.run();
            if (!result_of_run().empty()) say_result(result_of_run());
            return code;
        }
    return 0;
}

}  // namespace
}  // namespace tvsgs

int main(int argc, char** argv) {
    return tvsgs::run_command([&] { return tvsgs::command(argc, argv); });
}
