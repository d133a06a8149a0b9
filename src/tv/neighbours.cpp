#include "tv/internal/neighbours.h"

#include "tv/internal/neighbours_impl.h"

namespace tvsgs {
namespace detail {

HostLists unpacked(const CompactLists& lists, int voters, int k, int usable) {
    HostLists out;
    out.receivers.resize(std::size_t(voters) * k);
    for (int voter = 0; voter < voters; ++voter)
        lists.receivers_of(SerialWarp{}, voter, out.receivers.data() + std::size_t(voter) * k);
    out.begin.push_back(0);
    for (int rank = 0; rank < usable; ++rank) {
        lists.for_each_voter<1>(SerialWarp{}, rank,
                                [&](std::uint32_t voter) { out.voters.push_back(voter); });
        out.begin.push_back(static_cast<std::int64_t>(out.voters.size()));
    }
    return out;
}

}  // namespace detail

void find_neighbours(const NeighbourQuery& query,
                     NeighbourScratch<Cpu>& scratch,
                     Neighbours<Cpu>& out,
                     const StageDone& done) {
    detail::find_neighbours(query, scratch, out, done);
}

}  // namespace tvsgs
