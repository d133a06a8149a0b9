// Several processes of a command, as mpirun starts them.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "comm/launch.h"

namespace tvsgs::test {

/// Empty: they cannot be started here.
inline std::string mpirun(int processes) {
    if (!has_mpi() || std::string(TVSGS_MPIRUN).empty()) return "";
    // More processes than cores, in a container, as root; other MPIs ignore these.
    return "OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 "
           "OMPI_MCA_rmaps_base_oversubscribe=1 OMPI_MCA_hwloc_base_binding_policy=none "
           "OMPI_MCA_btl_vader_single_copy_mechanism=none " TVSGS_MPIRUN " -n " +
           std::to_string(processes) + " ";
}

}  // namespace tvsgs::test

#define TVSGS_SKIP_WITHOUT_MPI()                                                      \
    if (tvsgs::test::mpirun(1).empty())                                               \
    GTEST_SKIP() << "built without MPI or without mpirun: several processes are not " \
                    "tested (Debian: libopenmpi-dev openmpi-bin)"
