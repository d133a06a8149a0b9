#include "mesh/fuse/tsdf_impl.h"

namespace tvsgs {
template void reserve_places(VoxelBlocks<Cuda>&, int);
template class TsdfVolume<Cuda>;
}  // namespace tvsgs
