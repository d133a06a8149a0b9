#include "mvs/stereo/patch_match_impl.h"

namespace tvsgs {
template StereoResult reconstruct_stereo(Cpu,
                                         const std::vector<View>&,
                                         const std::vector<Vec3f>&,
                                         const StereoOptions&);
}  // namespace tvsgs
