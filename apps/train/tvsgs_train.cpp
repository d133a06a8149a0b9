// tvsgs-train: scene in, splats out; by itself or as one of several processes.
#include <chrono>
#include <cstdlib>
#include <thread>

#include "apps/common/command_line.h"
#include "apps/train/command.h"

namespace tvsgs {
namespace {

/// What the first process says stands for all, as it mostly ends all; another one waits for it
/// before it says something itself.
void let_the_first_one_speak(int rank) {
    if (rank > 0) std::this_thread::sleep_for(std::chrono::seconds(1));
}

/// A process that has failed ends the others, too.
int end_together(Communicator& peers, int code) {
    if (code != 0 && code <= 128) peers.abort(code);
    const int left = run_command([&] {
        peers.leave();
        return code;
    });
    if (left != code) peers.abort(left);
    return code;
}

}  // namespace
}  // namespace tvsgs

int main(int argc, char** argv) {
    using namespace tvsgs;
    Processes job;
    const int code = run_command(
        [&] {
            job.launch = read_launch(std::getenv);
            job.peers = join_by_mpi(job.launch);
            job.join_gpus = join_by_nccl;
            job.gpus_can_meet = has_nccl();
            return train_command(argc, argv, job);
        },
        [&] { let_the_first_one_speak(job.launch.rank); });
    return job.peers ? end_together(*job.peers, code) : code;
}
