#include "apps/bench/stability_measure.h"

#include <algorithm>

#include "apps/bench/stability_rows.h"

namespace tvsgs {

const StabilityPoint& StabilityCurve::worst() const {
    return *std::max_element(points.begin(), points.end(),
                             [](auto& a, auto& b) { return a.share < b.share; });
}

std::vector<StabilityCurve> measure_stability(Cpu) {
    return stability::measure<Cpu>();
}

}  // namespace tvsgs
