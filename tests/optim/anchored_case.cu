#include "anchored_case.h"

namespace tvsgs::test {

AnchoredResult evaluate_cuda(const AnchoredCase& c, std::size_t resume_before) {
    return evaluate<Cuda>(c, resume_before);
}

}  // namespace tvsgs::test
