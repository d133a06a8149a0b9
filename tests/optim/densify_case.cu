#include "densify_case.h"

namespace tvsgs::test {

DensifyResult densify_case_cuda() {
    return densify_case<Cuda>();
}

}  // namespace tvsgs::test
