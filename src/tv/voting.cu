#include "tv/internal/warp_cuda.h"
#include "tv/voting.h"
// After the CUDA loops and sorts that it calls.
#include "tv/internal/voting_impl.h"

namespace tvsgs {

template void find_neighbours(const NeighbourQuery&,
                              NeighbourScratch<Cuda>&,
                              Neighbours<Cuda>&,
                              const StageDone&);
template class TensorVoter<Cuda>;

}  // namespace tvsgs
