#include "mesh/fuse/tsdf_impl.h"

namespace tvsgs {
template void reserve_places(VoxelBlocks<Cpu>&, int);
template class TsdfVolume<Cpu>;
}  // namespace tvsgs
