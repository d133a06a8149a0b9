#include "densify_case.h"

namespace tvsgs::test {

DensifyResult densify_case_cuda(GrowthRule rule) {
    return densify_case<Cuda>(rule);
}

}  // namespace tvsgs::test
