# Processes of one training by MPI. TVSGS_MPI = AUTO: where it is found; ON: it has to be; OFF: never, the default, as
# tvsgs-train then starts on machines without it, too. Sets TVSGS_MPI_FOUND; the tests try it in a program of their own
# wherever it is (MPI_CXX_FOUND). Debian: libopenmpi-dev openmpi-bin, or libmpich-dev.
set(TVSGS_MPI OFF CACHE STRING "tvsgs-train runs as several processes by MPI: AUTO, ON or OFF")
set_property(CACHE TVSGS_MPI PROPERTY STRINGS AUTO ON OFF)
set(TVSGS_MPI_FOUND OFF)
if(TVSGS_TESTS OR TVSGS_MPI STREQUAL "AUTO" OR TVSGS_MPI)
    set(MPI_CXX_SKIP_MPICXX ON)
    find_package(MPI QUIET COMPONENTS CXX)
endif()
if(TVSGS_MPI STREQUAL "AUTO" OR TVSGS_MPI)
    if(MPI_CXX_FOUND)
        set(TVSGS_MPI_FOUND ON)
    elseif(NOT TVSGS_MPI STREQUAL "AUTO")
        message(FATAL_ERROR "TVSGS_MPI=ON, but MPI was not found (Debian: libopenmpi-dev)")
    else()
        message(STATUS "MPI not found: tvsgs-train runs as one process (Debian: libopenmpi-dev)")
    endif()
endif()
