// The processes of one run: rank 0 decides, logs and writes; the others follow.
// [docs/guide/ranks.md]
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "comm/communicator.h"
#include "comm/launch.h"
#include "core/device_choice.h"
#include "core/scene.h"
#include "optim/train.h"

namespace tvsgs {

/// What happens at the beginning of a step; `show`: it goes on, and then its splats are shown.
enum class NextStep : std::uint8_t { go_on, show, stop, fit };
inline bool ends(NextStep next) {
    return next == NextStep::stop || next == NextStep::fit;
}

/// What the processes of a session tell each other; by itself, where `peers` is null, a process
/// agrees with what it says.
class RankTalk {
public:
    explicit RankTalk(Communicator* peers) : peers_(peers) {}

    /// What rank 0 says; a signal that any of them has received stops all, and is noted by all.
    NextStep next(NextStep said);

    /// Whether rank 0 says so.
    bool agree(const char* what, bool said);

    /// work() on rank 0, for which the others wait.
    template <class Work>
    void alone(const Work& work) {
        if (rank_of(peers_) == 0) work();
        if (peers_ != nullptr) peers_->wait_for_all("rank 0 works alone");
    }

    /// Gives `options` the schedule of rank 0.
    void share_schedule(TrainOptions& options);

private:
    Communicator* peers_;
};

/// Names and values.
using Facts = std::vector<std::pair<std::string, std::string>>;

/// Throws Error(ExitCode::usage) that names the first of `facts`, of what `whose` says, in which
/// this process differs from rank 0.
void require_same_facts(Communicator* peers, const std::string& whose, const Facts& facts);

/// What makes a scene: its views, photographs and initial points.
Facts facts_of(const Scene& scene);

/// As choose_device(); of several processes on a machine each takes a GPU of its own. Throws
/// Error(ExitCode::device) where there are not enough.
DeviceChoice choose_device(const std::string& name, const Launch& launch);

/// Growth stops where the process with the least memory has to.
void share_memory_limits(Communicator* peers, TrainOptions& options);

}  // namespace tvsgs
