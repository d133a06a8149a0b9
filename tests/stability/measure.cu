#include "stability/rows.h"

namespace tvsgs {

std::vector<StabilityCurve> measure_stability(Cuda) {
    return stability::measure<Cuda>();
}

}  // namespace tvsgs
