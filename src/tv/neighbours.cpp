#include "tv/neighbours.h"

#include "tv/neighbours_impl.h"

namespace tvsgs {
namespace detail {

void reverse_lists(NeighbourScratch<Cpu>&, Neighbours<Cpu>& out) {
    // A counting sort of the edges by receiver, voters in ascending order.
    std::vector<std::int64_t> next(std::size_t(out.usable) + 1, 0);
    for (const std::uint32_t receiver : out.receivers.span()) ++next[receiver + std::size_t(1)];
    for (int i = 0; i < out.usable; ++i) next[i + 1] += next[i];
    copy(next, out.begin);
    for (std::size_t e = 0; e < out.receivers.size(); ++e)
        out.voters[next[out.receivers[e]]++] = static_cast<std::uint32_t>(e / out.k);
}

}  // namespace detail

void find_neighbours(const NeighbourQuery& query,
                     NeighbourScratch<Cpu>& scratch,
                     Neighbours<Cpu>& out,
                     const StageDone& done) {
    detail::find_neighbours(query, scratch, out, done);
}

}  // namespace tvsgs
