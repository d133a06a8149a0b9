#include "pipeline/ranks.h"

#include <algorithm>
#include <cstring>

#include "core/cuda_device.h"
#include "optim/schedule.h"
#include "pipeline/checkpoints.h"
#include "pipeline/signals.h"

namespace tvsgs {

NextStep RankTalk::next(NextStep said) {
    if (peers_ == nullptr) return said;
    struct Message {
        std::int32_t signal;
        NextStep next;
    } const mine{SignalGuard::received(), said};
    std::vector<std::byte> all;
    peers_->all_gather_v("next step", &mine, sizeof mine, all);
    // By what all have read, as one more signal may come meanwhile.
    NextStep next = said;
    bool stop = false;
    for (int r = peers_->size() - 1; r >= 0; --r) {
        Message message;
        std::memcpy(&message, all.data() + static_cast<std::size_t>(r) * sizeof message,
                    sizeof message);
        if (message.signal != 0) SignalGuard::note(message.signal);
        stop |= message.signal != 0;
        next = message.next;
    }
    return stop ? NextStep::stop : next;
}

bool RankTalk::agree(const char* what, bool said) {
    if (peers_ != nullptr) peers_->broadcast(what, &said, sizeof said, 0);
    return said;
}

void RankTalk::share_schedule(TrainOptions& options) {
    if (peers_ == nullptr) return;
    std::vector<int> numbers;
    visit_schedule(options,
                   [&](const std::string&, int number, Counts) { numbers.push_back(number); });
    peers_->broadcast("schedule", numbers.data(), numbers.size() * sizeof(int), 0);
    std::size_t next = 0;
    visit_schedule(options,
                   [&](const std::string&, int& number, Counts) { number = numbers[next++]; });
}

void require_same_facts(Communicator* peers, const std::string& whose, const Facts& facts) {
    if (peers == nullptr) return;
    // One after the other, each ended by what no text has.
    std::string mine;
    for (const auto& [name, value] : facts) (mine += name + '\0') += value + '\0';
    const std::string first = peers->broadcast("facts", mine, 0);
    if (first == mine) return;
    std::size_t at = 0;
    const auto word = [&]() -> std::string {
        const std::size_t end = std::min(first.find('\0', at), first.size());
        const std::string found = first.substr(std::min(at, end), end - at);
        at = end + 1;
        return at > first.size() + 1 ? "" : found;
    };
    for (const auto& [name, value] : facts) {
        const std::string other_name = word(), other = word();
        if (other_name == name && other == value) continue;
        throw Error(
            ExitCode::usage,
            str(whose, " of rank ", peers->rank(), ": ", name, " is '", value, "', and rank 0 has ",
                other_name == name ? "" : str(other_name, " "), "'", other,
                "'; expected the same for all processes: one command, one environment, one "
                "scene"));
    }
    throw Error(ExitCode::usage, str(whose, " of rank 0 has more to it than that of rank ",
                                     peers->rank(), "; expected the same for all processes"));
}

Facts facts_of(const Scene& scene) {
    return {{"training views", str(scene.train.size())},
            {"names and poses of the views", str(views_id(scene))},
            {"photographs", str(photos_id(scene))},
            {"initial points", str(scene.points.positions.size())},
            {"places of the initial points", str(points_id(scene))},
            {"fixed splats", str(scene.fixed_splats ? scene.fixed_splats->size() : 0)}};
}

DeviceChoice choose_device(const std::string& name, const Launch& launch) {
    if (!launch.several()) return choose_device(name);
    if (name.starts_with("cuda:"))
        throw Error(ExitCode::usage, str("--device ", name, " with ", launch.size,
                                         " processes: each takes a GPU of its own; expected auto, "
                                         "cpu or cuda"));
    int gpus = 0;
    if constexpr (kHasCuda) gpus = name == "cpu" ? 0 : cuda_device_count();
    // Where a launcher shows each process its own GPU only, that is number 0.
    const int index = gpus > 1 ? launch.local_rank : 0;
    if (gpus > 1 && index >= gpus)
        throw Error(ExitCode::device,
                    str("process ", launch.local_rank, " of this machine, counted from 0, and ",
                        gpus, " GPUs; expected a GPU for each process"));
    return choose_device(gpus > 0 || name == "cuda" ? str("cuda:", index) : name);
}

void share_memory_limits(Communicator* peers, TrainOptions& options) {
    if (peers == nullptr) return;
    std::vector<std::int64_t> limits{options.densify.max_gaussians};
    peers->all_reduce("memory limits", Communicator::Reduce::min, limits);
    options.densify.max_gaussians = static_cast<int>(limits[0]);
}

}  // namespace tvsgs
