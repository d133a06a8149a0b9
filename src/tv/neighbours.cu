#include "tv/internal/neighbours.h"
#include "tv/internal/warp_cuda.h"
// After the CUDA loops and sorts that it calls.
#include "tv/internal/neighbours_impl.h"

namespace tvsgs {

void find_neighbours(const NeighbourQuery& query,
                     NeighbourScratch<Cuda>& scratch,
                     Neighbours<Cuda>& out,
                     const StageDone& done) {
    detail::find_neighbours(query, scratch, out, done);
}

}  // namespace tvsgs
