// tvsgs-bench: stage timings, and agreement with stored results; one class per subcommand.
#include "bench_stability.h"
#include "bench_stages.h"
#include "bench_train.h"
#include "bench_vote.h"
#include "common.h"

namespace tvsgs {
namespace {

int command(int argc, char** argv) {
    CLI::App app{"Measures the program itself.", "tvsgs-bench"};
    app.require_subcommand(1);
    app.set_version_flag("--version", kVersion);
    const VoteBench vote(app);
    const StagesBench stages(app);
    const TrainBench train(app);
    const StabilityBench stability(app);
    parse_command_line(app, argc, argv);
    init_log(vote.quiet() || stages.quiet() || train.quiet() ? Verbosity::quiet
                                                             : Verbosity::normal);
    return vote.parsed()        ? vote.run()
           : stages.parsed()    ? stages.run()
           : stability.parsed() ? stability.run()
                                : train.run();
}

}  // namespace
}  // namespace tvsgs

int main(int argc, char** argv) {
    return tvsgs::run_command([&] { return tvsgs::command(argc, argv); });
}
