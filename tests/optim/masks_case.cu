#include "masks_case.h"

namespace tvsgs::test {

MaskResult evaluate_masks_cuda(const MaskCase& c) {
    return evaluate_masks<Cuda>(c);
}

}  // namespace tvsgs::test
