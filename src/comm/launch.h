// Whether a launcher (mpirun, srun, a script) has started this process as one of several.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "comm/communicator.h"
#include "comm/options.h"

namespace tvsgs {

/// What the environment says.
struct Launch {
    enum class By { none, mpi, environment } by = By::none;
    std::string launcher;  // for messages
    int rank = 0, size = 1, local_rank = 0;
    std::string job;  // tells jobs of one user apart, where the launcher does

    bool several() const { return size > 1; }
};

/// Open MPI's and MPICH's mpirun and srun --mpi say that MPI knows more; srun without it, and
/// RANK, WORLD_SIZE and LOCAL_RANK, as torchrun sets them, that the processes have to find each
/// other by themselves. `env` is as std::getenv(). Throws Error(ExitCode::usage) for numbers that
/// are none.
Launch read_launch(const std::function<const char*(const char*)>& env);

/// The processes that MPI has started; null: this one is by itself. Throws Error(ExitCode::usage)
/// where launcher and MPI disagree, or the program knows no MPI.
std::unique_ptr<Communicator> join_by_mpi(const Launch& launch);

/// Processes with a GPU each, the current one of this process, which exchange through NCCL. They
/// find each other by `mpi`, or by a file where that is null. A program without NCCL gives `mpi`
/// back. Throws Error.
std::unique_ptr<Communicator> join_by_nccl(const Launch& launch,
                                           const CommOptions& options,
                                           std::unique_ptr<Communicator> mpi);

/// Whether the program was built with them.
bool has_mpi();
bool has_nccl();

}  // namespace tvsgs
