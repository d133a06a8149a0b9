#include "tv/internal/warp_cuda.h"
#include "tv/voting.h"
// After the CUDA loops and sorts that it calls.
#include "tv/internal/voting_details.h"
#include "tv/internal/voting_impl.h"

namespace tvsgs {

template class TensorVoter<Cuda>;

}  // namespace tvsgs
