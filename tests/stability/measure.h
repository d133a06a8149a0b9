// The stability suite: formulas in float against double, from mild to extreme inputs; each row is
// held to a bound. Rows: rows.h; docs/develop/stability.md.
#pragma once

#include <string>
#include <vector>

#include "core/device/device.h"

namespace tvsgs {

/// A row's worst case at one value of its stress parameter. Errors are relative to the row's own
/// size of a result.
struct StabilityPoint {
    double stress = 0;
    double error = 0, bound = 0;  // the largest of each
    double share = 0;             // the largest error / bound of one case: above 1 is a failure
};

struct StabilityCurve {
    std::string operation, stress, bound, guard;
    std::vector<StabilityPoint> points;

    const StabilityPoint& worst() const;  // that of the largest share
};

/// All rows in float on this device, against double on the CPU.
std::vector<StabilityCurve> measure_stability(Cpu);
std::vector<StabilityCurve> measure_stability(Cuda);

}  // namespace tvsgs
