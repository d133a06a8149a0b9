#include "tv/voting.h"
#include "tv/warp_cuda.h"
// After the CUDA loops and sorts that it calls.
#include "tv/voting_impl.h"

namespace tvsgs {

template class TensorVoter<Cuda>;

}  // namespace tvsgs
