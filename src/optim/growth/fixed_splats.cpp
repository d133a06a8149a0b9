#include "optim/growth/fixed_splats_impl.h"

namespace tvsgs {

template class FixedSplats<Cpu>;

}  // namespace tvsgs
