#include "tv/voting.h"

#include "core/log.h"
#include "tv/internal/voting_impl.h"

namespace tvsgs {
namespace detail {

void warn_too_few(int usable, int count) {
    spdlog::warn("tensor voting is off: {} of {} splats can take part, and it needs two", usable,
                 count);
}

void warn_noise(double share) {
    spdlog::warn(
        "tensor voting: the regulariser of the whitening is {:.0f} % of the size of the middle "
        "splat, since few very large ones raise it: the small ones vote as if they were rounder; "
        "consider --set tv.whiten_noise_mode=per_splat",
        100 * share);
}

HostLists unpacked(const CompactLists& lists, int voters, int k, int usable) {
    HostLists out;
    out.receivers.resize(std::size_t(voters) * k);
    for (int voter = 0; voter < voters; ++voter)
        lists.receivers_of(SerialWarp{}, voter, out.receivers.data() + std::size_t(voter) * k);
    out.begin.push_back(0);
    for (int rank = 0; rank < usable; ++rank) {
        lists.for_each_voter<1>(SerialWarp{}, rank,
                                [&](std::uint32_t voter) { out.voters.push_back(voter); });
        out.begin.push_back(std::int64_t(out.voters.size()));
    }
    return out;
}

}  // namespace detail

template void find_neighbours(const NeighbourQuery&,
                              NeighbourScratch<Cpu>&,
                              Neighbours<Cpu>&,
                              const StageDone&);
template class TensorVoter<Cpu>;

}  // namespace tvsgs
