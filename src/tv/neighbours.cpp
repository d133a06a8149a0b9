#include "tv/neighbours.h"

#include "tv/neighbours_impl.h"

namespace tvsgs {
namespace detail {

void reverse_lists(Span<const TreePoint> points,
                   NeighbourScratch<Cpu>& scratch,
                   Neighbours<Cpu>& out) {
    // A counting sort of the edges by receiver, voters in ascending order.
    const int count = static_cast<int>(out.begin.size()) - 1, k = out.k;
    scratch.cursors.resize(count);
    scratch.cursors.fill_zero();
    for (const TreePoint& point : points) scratch.cursors[point.index] = 1;
    std::vector<std::int64_t> next(count + std::size_t(1), 0);
    for (int voter = 0; voter < count; ++voter)
        if (scratch.cursors[voter] == 1)
            for (int r = 0; r < k; ++r)
                ++next[out.receivers[std::size_t(voter) * k + r] + std::size_t(1)];
    for (int i = 0; i < count; ++i) next[i + 1] += next[i];
    copy(next, out.begin);
    for (int voter = 0; voter < count; ++voter)
        if (scratch.cursors[voter] == 1)
            for (int r = 0; r < k; ++r)
                out.voters[next[out.receivers[std::size_t(voter) * k + r]]++] =
                    static_cast<std::uint32_t>(voter);
}

}  // namespace detail

void find_neighbours(const SplatSpans& splats,
                     int k,
                     const WhitenRule& rule,
                     const double* noise,
                     NeighbourScratch<Cpu>& scratch,
                     Neighbours<Cpu>& out) {
    detail::find_neighbours(splats, k, rule, noise, scratch, out);
}

}  // namespace tvsgs
