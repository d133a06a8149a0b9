#include "mesh/fuse/large_splats.h"

namespace tvsgs {

std::size_t fade_large(const std::vector<Camera>& cameras,
                       float max_px,
                       Gaussians<Cuda>& gaussians) {
    return detail::fade_large_on(cameras, max_px, gaussians);
}

}  // namespace tvsgs
