#include "masks_case.h"

namespace tvsgs::test {

MaskResult evaluate_masks_cuda(const MaskCase& c) {
    return evaluate_masks<Cuda>(c);
}
std::vector<Vec3f> bound_splats_cuda(const Gaussians<Cpu>& host,
                                     const std::vector<Camera>& cameras,
                                     const BoundOptions& bounds,
                                     int halted) {
    return bound_splats<Cuda>(host, cameras, bounds, halted);
}

}  // namespace tvsgs::test
