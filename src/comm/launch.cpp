#include "comm/launch.h"

#include <charconv>
#include <optional>
#include <string_view>

namespace tvsgs {
namespace {

using Environment = std::function<const char*(const char*)>;

std::optional<int> number_of(const Environment& env, const char* name) {
    const char* const text = env(name);
    if (text == nullptr || *text == 0) return std::nullopt;
    const std::string_view all(text);
    int value = 0;
    const auto [end, error] = std::from_chars(all.data(), all.data() + all.size(), value);
    if (error != std::errc{} || end != all.data() + all.size() || value < 0)
        throw Error(ExitCode::usage, str("environment: ", name, "=", all,
                                         ": expected a number of the launcher, 0 or more"));
    return value;
}

std::string text_of(const Environment& env, const char* name) {
    const char* const text = env(name);
    return text == nullptr ? "" : text;
}

Launch checked(Launch launch) {
    if (launch.rank >= launch.size)
        throw Error(
            ExitCode::usage,
            str("environment: ", launch.launcher, " says that this is process ", launch.rank,
                " of ", launch.size, ", which count from 0; expected a smaller number"));
    return launch;
}

}  // namespace

Launch read_launch(const Environment& env) {
    struct Names {
        Launch::By by;
        const char *launcher, *rank, *size, *local_rank, *job;
    };
    using enum Launch::By;
    constexpr Names kLaunchers[] = {
        {mpi, "mpirun (Open MPI)", "OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE",
         "OMPI_COMM_WORLD_LOCAL_RANK", "PMIX_NAMESPACE"},
        {mpi, "mpiexec (PMI)", "PMI_RANK", "PMI_SIZE", "MPI_LOCALRANKID", "PMI_JOBID"},
        {mpi, "srun (PMIx)", "PMIX_RANK", "SLURM_STEP_NUM_TASKS", "SLURM_LOCALID", "SLURM_JOB_ID"},
        {environment, "srun", "SLURM_PROCID", "SLURM_STEP_NUM_TASKS", "SLURM_LOCALID",
         "SLURM_JOB_ID"},
        {environment, "a launcher that sets RANK and WORLD_SIZE", "RANK", "WORLD_SIZE",
         "LOCAL_RANK", "TORCHELASTIC_RUN_ID"}};
    for (const Names& names : kLaunchers) {
        const auto rank = number_of(env, names.rank), size = number_of(env, names.size);
        if (!rank || !size) continue;
        return checked({names.by, names.launcher, *rank, *size,
                        number_of(env, names.local_rank).value_or(*rank), text_of(env, names.job)});
    }
    return {};
}

}  // namespace tvsgs
