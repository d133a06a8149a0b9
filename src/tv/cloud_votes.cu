#include "tv/internal/warp_cuda.h"
// After the CUDA loops and sorts that it calls.
#include "tv/internal/cloud_votes_impl.h"

namespace tvsgs {

template CloudVotes vote_in_cloud(Cuda,
                                  const PointCloud&,
                                  const CloudVoteOptions&,
                                  const CloudProgress&);

}  // namespace tvsgs
