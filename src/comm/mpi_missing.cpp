// Built without MPI.
#include "comm/launch.h"

namespace tvsgs {

bool has_mpi() {
    return false;
}

std::unique_ptr<Communicator> join_by_mpi(const Launch& launch) {
    if (launch.by == Launch::By::mpi && launch.several())
        throw Error(ExitCode::usage,
                    str(launch.launcher, " has started ", launch.size,
                        " processes, but this program was built without MPI; expected a build with "
                        "-DTVSGS_MPI=ON, or one process"));
    return nullptr;
}

}  // namespace tvsgs
