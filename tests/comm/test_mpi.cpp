// The MPI backend, in processes of its own.
#include <unistd.h>

#include "support/command.h"
#include "support/mpirun.h"

namespace tvsgs {
namespace {

Result on_ranks(int ranks, const std::string& arguments) {
    const auto folder =
        std::filesystem::path(testing::TempDir()) / ("tvsgs_mpi_" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder);
    const Result result =
        run_script(folder, "timeout 60 env " + test::mpirun(ranks) + TVSGS_BIN_DIR "/mpi_ranks " +
                               arguments + " >out.txt 2>err.txt");
    std::filesystem::remove_all(folder);
    return result;
}

TEST(Mpi, GathersUnevenParts) {
    TVSGS_SKIP_WITHOUT_MPI();
    for (const int ranks : {2, 3, 4}) {
        const Result result = on_ranks(ranks, "");
        EXPECT_EQ(result.code, 0) << ranks << " ranks, " << result;
    }
}

TEST(Mpi, AProcessThatDoesNotComeEndsTheOthers) {
    TVSGS_SKIP_WITHOUT_MPI();
    const Result result = on_ranks(3, "alone");
    EXPECT_EQ(result.code, static_cast<int>(ExitCode::peer)) << result;
    EXPECT_TRUE(
        result.says("has waited 1 s for the others (comm.timeout) (call 'text', iteration "
                    "7)"))
        << result;
}

}  // namespace
}  // namespace tvsgs
