// tvsgs-blocks: trains scenes larger than one GPU in cells of the ground, each with an ordinary
// tvsgs-train that any batch system can start, and merges the results. [docs/guide/blocks.md]
#include "apps/blocks/subcommands.h"

int tvsgs::command(int argc, char** argv) {
    CLI::App app{"Trains scenes larger than one GPU in blocks.", "tvsgs-blocks"};
    app.footer(
        "Example:\n"
        "  tvsgs-blocks split --scene SCENE --out BLOCKS --blocks 4\n"
        "  tvsgs-blocks run BLOCKS --gpus all\n"
        "  tvsgs-blocks merge BLOCKS --out RUN");
    return run_subcommand(app,
                          {add_blocks_split(app), add_blocks_run(app), add_blocks_slurm(app),
                           add_blocks_status(app), add_blocks_merge(app)},
                          Verbosity::normal, argc, argv);
}
