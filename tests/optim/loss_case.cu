#include "loss_case.h"

namespace tvsgs::test {

LossResult evaluate_cuda(const LossCase& c, Term term, float weight, Reduction reduction) {
    return evaluate<Cuda>(c, term, weight, reduction);
}

}  // namespace tvsgs::test
