#include "tv/internal/neighbours.h"

#include "tv/internal/neighbours_impl.h"

namespace tvsgs {
namespace detail {

HostLists unpacked(const CompactLists& lists, Part voters, int k, Part receivers) {
    HostLists out;
    out.receivers.resize(std::size_t(voters.size()) * k);
    for (int voter = voters.begin; voter < voters.end; ++voter)
        lists.receivers_of(SerialWarp{}, voter,
                           out.receivers.data() + std::size_t(voter - voters.begin) * k);
    out.begin.push_back(0);
    for (int rank = receivers.begin; rank < receivers.end; ++rank) {
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
