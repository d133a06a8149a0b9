#include "densify_case.h"

namespace tvsgs::test {

DensifyResult densify_case_cuda(GrowthRule rule, float spare_covered) {
    return densify_case<Cuda>(rule, spare_covered);
}

}  // namespace tvsgs::test
