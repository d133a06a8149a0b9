// tvsgs-bench: stage timings, and agreement with stored results.
#include "apps/bench/subcommands.h"

int tvsgs::command(int argc, char** argv) {
    CLI::App app{"Measures the speed and the accuracy of the program itself.", "tvsgs-bench"};
    return run_subcommand(app, {add_bench_vote(app), add_bench_stages(app)}, Verbosity::normal,
                          argc, argv);
}
