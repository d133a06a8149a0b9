#include "loss_case.h"

namespace tvsgs::test {

LossResult evaluate_cuda(const LossCase& c, Term term, float weight, Reduction reduction) {
    return evaluate<Cuda>(c, term, weight, reduction);
}

LossResult evaluate_cuda(const LossCase& c,
                         const LossOptions& options,
                         const LossContext& context,
                         int step) {
    return evaluate<Cuda>(c, options, context, step);
}

}  // namespace tvsgs::test
