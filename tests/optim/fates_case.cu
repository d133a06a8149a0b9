#include "fates_case.h"

namespace tvsgs::test {

FatesResult evaluate_cuda(const FatesCase& c) {
    return evaluate<Cuda>(c);
}

}  // namespace tvsgs::test
