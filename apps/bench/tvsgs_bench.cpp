// tvsgs-bench: stage timings, and agreement with stored results; one class per subcommand.
#include "apps/bench/stages.h"
#include "apps/bench/train.h"
#include "apps/bench/vote.h"
#include "apps/common/command_line.h"

namespace tvsgs {
namespace {

int command(int argc, char** argv) {
    CLI::App app{"Measures the speed and the accuracy of the program itself.", "tvsgs-bench"};
    app.require_subcommand(1);
    const VoteBench vote(app);
    const StagesBench stages(app);
    TrainBench train(app);
    parse_command_line(app, argc, argv);
    init_log(vote.quiet() || stages.quiet() || train.quiet() ? Verbosity::quiet
                                                             : Verbosity::normal);
    return vote.parsed() ? vote.run() : stages.parsed() ? stages.run() : train.run();
}

}  // namespace
}  // namespace tvsgs

int main(int argc, char** argv) {
    return tvsgs::run_command([&] { return tvsgs::command(argc, argv); });
}
