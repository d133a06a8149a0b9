#include "densify_case.h"

namespace tvsgs::test {

DensifyResult densify_case_cuda(GrowthRule rule, float growth_in_gaps_only) {
    return densify_case<Cuda>(rule, growth_in_gaps_only);
}

}  // namespace tvsgs::test
