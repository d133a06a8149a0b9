// What launchers say in the environment.
#include <gtest/gtest.h>

#include <map>

#include "comm/launch.h"
#include "comm/rendezvous.h"

namespace tvsgs {
namespace {

Launch launch_of(const std::map<std::string, std::string>& variables) {
    return read_launch([&](const char* name) {
        const auto found = variables.find(name);
        return found == variables.end() ? nullptr : found->second.c_str();
    });
}

TEST(Launch, OfEachLauncher) {
    EXPECT_FALSE(launch_of({}).several());
    const Launch open = launch_of({{"OMPI_COMM_WORLD_RANK", "2"},
                                   {"OMPI_COMM_WORLD_SIZE", "4"},
                                   {"OMPI_COMM_WORLD_LOCAL_RANK", "1"},
                                   {"PMIX_RANK", "2"},
                                   {"SLURM_NTASKS", "1"}});
    EXPECT_EQ(open.by, Launch::By::mpi);
    EXPECT_EQ(open.rank, 2);
    EXPECT_EQ(open.size, 4);
    EXPECT_EQ(open.local_rank, 1);
    EXPECT_TRUE(open.several());
    const Launch hydra =
        launch_of({{"PMI_RANK", "0"}, {"PMI_SIZE", "2"}, {"MPI_LOCALRANKID", "0"}});
    EXPECT_EQ(hydra.by, Launch::By::mpi);
    const Launch pmix = launch_of({{"PMIX_RANK", "1"},
                                   {"SLURM_PROCID", "1"},
                                   {"SLURM_STEP_NUM_TASKS", "2"},
                                   {"SLURM_LOCALID", "0"}});
    EXPECT_EQ(pmix.by, Launch::By::mpi);
    EXPECT_EQ(pmix.local_rank, 0);
    const Launch torch = launch_of({{"RANK", "3"}, {"WORLD_SIZE", "4"}, {"LOCAL_RANK", "3"}});
    EXPECT_EQ(torch.by, Launch::By::environment);
    EXPECT_EQ(torch.rank, 3);
}

TEST(Launch, ABatchScriptIsOneProcess) {
    // What sbatch -n 4 sets for the script itself.
    EXPECT_FALSE(launch_of({{"SLURM_PROCID", "0"}, {"SLURM_NTASKS", "4"}}).several());
    EXPECT_FALSE(launch_of({{"SLURM_PROCID", "0"}, {"SLURM_STEP_NUM_TASKS", "1"}}).several());
}

TEST(Launch, RefusesWhatCannotBe) {
    for (const char* rank : {"4", "-1", "two", "1x"}) {
        try {
            launch_of({{"OMPI_COMM_WORLD_RANK", rank}, {"OMPI_COMM_WORLD_SIZE", "4"}});
            ADD_FAILURE() << rank;
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::usage);
            EXPECT_NE(std::string(error.what()).find(rank), std::string::npos);
        }
    }
}

TEST(Launch, OneProcessNeedsNobody) {
    EXPECT_EQ(join_by_mpi({}), nullptr);
    Launch one;
    one.by = Launch::By::mpi;
    EXPECT_EQ(join_by_mpi(one), nullptr);
}

TEST(Rendezvous, ByTheJobOrByAFileThatIsNamed) {
    Launch launch;
    launch.launcher = "a launcher that sets RANK and WORLD_SIZE";
    CommOptions options;
    try {
        rendezvous_file(launch, options);
        ADD_FAILURE() << "processes with different parents would wait for each other";
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::usage);
        EXPECT_NE(std::string(error.what()).find("--set comm.rendezvous=FILE"), std::string::npos);
    }
    launch.job = "17";
    const std::string of_17 = rendezvous_file(launch, options);
    EXPECT_EQ(of_17, rendezvous_file(launch, options));
    launch.job = "18";
    EXPECT_NE(of_17, rendezvous_file(launch, options));
    options.rendezvous = "here";
    EXPECT_EQ(rendezvous_file(launch, options), "here");
}

}  // namespace
}  // namespace tvsgs
