#include "tv/internal/warp_cuda.h"
// After the CUDA loops and sorts that it calls.
#include "tv/internal/cloud_votes_impl.h"

namespace tvsgs {

CloudVotes vote_in_cloud(Cuda,
                         const PointCloud& cloud,
                         const CloudVoteOptions& options,
                         const CloudProgress& progress) {
    return detail::vote_in_cloud<Cuda>(cloud, options, progress);
}

}  // namespace tvsgs
