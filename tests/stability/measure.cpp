#include "stability/measure.h"

#include <algorithm>

#include "stability/rows.h"

namespace tvsgs {

const StabilityPoint& StabilityCurve::worst() const {
    return *std::max_element(points.begin(), points.end(),
                             [](auto& a, auto& b) { return a.share < b.share; });
}

std::vector<StabilityCurve> measure_stability(Cpu) {
    return stability::measure<Cpu>();
}

}  // namespace tvsgs
