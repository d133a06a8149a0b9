// tvsgs-blocks: trains scenes larger than one GPU in cells of the ground, each with an ordinary
// tvsgs-train that any batch system can start, and merges the results. [docs/guide/blocks.md]
#include "apps/blocks/subcommands.h"

namespace tvsgs {
namespace {

int command(int argc, char** argv) {
    bool quiet = false;
    CLI::App app{"Trains scenes larger than one GPU in blocks.", "tvsgs-blocks"};
    app.footer(
        "Example:\n"
        "  tvsgs-blocks split --scene SCENE --out BLOCKS --blocks 4\n"
        "  tvsgs-blocks run BLOCKS --gpus all\n"
        "  tvsgs-blocks merge BLOCKS --out RUN");
    app.require_subcommand(1);
    const BlocksCommand commands[] = {add_blocks_split(app), add_blocks_run(app),
                                      add_blocks_slurm(app), add_blocks_status(app),
                                      add_blocks_merge(app)};
    for (const BlocksCommand& c : commands)
        c.command->add_flag("--quiet", quiet, "warnings and errors only");
    parse_command_line(app, argc, argv);
    init_log(quiet ? Verbosity::quiet : Verbosity::normal);
    for (const BlocksCommand& c : commands)
        if (c.command->parsed()) return c.run(quiet);
    return 0;
}

}  // namespace
}  // namespace tvsgs

int main(int argc, char** argv) {
    return tvsgs::run_command([&] { return tvsgs::command(argc, argv); });
}
