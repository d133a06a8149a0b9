#include "multiview_case.h"

namespace tvsgs::test {

MultiViewResult evaluate_cuda(const MultiViewCase& c, bool geometry, float weight) {
    return evaluate<Cuda>(c, geometry, weight);
}

ExposureResult evaluate_exposure_cuda(const ExposureCase& c, int steps) {
    return evaluate_exposure<Cuda>(c, steps);
}

}  // namespace tvsgs::test
