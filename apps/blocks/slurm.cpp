// tvsgs-blocks slurm: prints a Slurm job array with one task per block.
#include <cstdio>
#include <filesystem>
#include <memory>

#include "apps/blocks/subcommands.h"

namespace tvsgs {
namespace {

struct SlurmArguments {
    std::string folder, device = "cuda";
};

/// Quotes a path for an sbatch option, whose rules differ from a shell's; '%' is written twice.
std::string for_sbatch(const std::string& path) {
    std::string quoted = "\"";
    for (const char c : path)
        quoted += c == '"' || c == '\\' ? str('\\', c) : c == '%' ? "%%" : std::string(1, c);
    return quoted + "\"";
}

/// A task that Slurm requeues after a node failure appends to its log and resumes from its
/// checkpoint. `exec` replaces sh, so that the signal before the time limit reaches tvsgs-blocks.
int print_job(const SlurmArguments& a) {
    const BlocksManifest manifest =
        read_manifest(std::filesystem::absolute(a.folder).lexically_normal().string());
    const bool cuda = a.device == "cuda";
    const std::string text =
        str("#!/bin/sh\n#SBATCH --job-name=tvsgs-blocks\n#SBATCH --array=1-", manifest.count(),
            cuda ? "\n#SBATCH --gres=gpu:1" : "",
            "\n#SBATCH --requeue\n#SBATCH --open-mode=append\n#SBATCH --signal=B:TERM@120\n",
            "#SBATCH --output=", for_sbatch(manifest.folder), "/block_%3a/train.log\n",
            "export OMP_NUM_THREADS=\"${SLURM_CPUS_ON_NODE:-1}\"\nexec tvsgs-blocks run ",
            for_shell(manifest.folder), " --block \"$SLURM_ARRAY_TASK_ID\" --device ", a.device,
            " \"$@\"\n");
    std::fputs(text.c_str(), stdout);
    return 0;
}

}  // namespace

Subcommand add_blocks_slurm(CLI::App& app) {
    const auto a = std::make_shared<SlurmArguments>();
    CLI::App* const command =
        app.add_subcommand("slurm", "print a job array for sbatch, one task per block");
    add_blocks_folder(*command, a->folder);
    add_choice(*command, "--device", a->device, {"cuda", "cpu"}, "cuda (one GPU per task) or cpu");
    return {command, [a] { return print_job(*a); }};
}

}  // namespace tvsgs
