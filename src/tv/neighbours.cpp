#include "tv/neighbours.h"

#include "tv/neighbours_impl.h"

namespace tvsgs {
void find_neighbours(const NeighbourQuery& query,
                     NeighbourScratch<Cpu>& scratch,
                     Neighbours<Cpu>& out,
                     const StageDone& done) {
    detail::find_neighbours(query, scratch, out, done);
}

}  // namespace tvsgs
