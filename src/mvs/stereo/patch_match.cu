#include "mvs/stereo/patch_match.h"
#include "mvs/stereo/patch_match_impl.h"

namespace tvsgs {

StereoResult reconstruct_stereo(Cuda,
                                const std::vector<View>& views,
                                const std::vector<Vec3f>& points,
                                const StereoOptions& options) {
    return PatchMatch<Cuda>(views, points, options).run();
}

}  // namespace tvsgs
