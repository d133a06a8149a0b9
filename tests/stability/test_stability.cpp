// Every row of the stability suite stays within its bound, on both devices, and the bounds can
// fail. docs/develop/stability.md
#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "stability/measure.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

void expect_within_bounds(const std::vector<StabilityCurve>& curves) {
    for (const StabilityCurve& c : curves)
        for (const StabilityPoint& p : c.points)
            EXPECT_LE(p.share, 1) << c.operation << " over " << c.stress << ", at " << p.stress
                                  << ": error " << p.error << ", bound " << p.bound << " ("
                                  << c.bound << ")";
}

TEST(Stability, RowsOnTheCpu) {
    expect_within_bounds(measure_stability(Cpu{}));
}

TEST(Stability, RowsOnTheGpu) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) expect_within_bounds(measure_stability(Cuda{}));
}

TEST(Stability, RowsSayWhatTheyMeasure) {
    const auto curves = measure_stability(Cpu{});
    std::set<std::string> names;
    for (const StabilityCurve& c : curves) {
        EXPECT_TRUE(names.insert(c.operation + c.stress).second) << c.operation << c.stress;
        EXPECT_FALSE(c.bound.empty());
        bool nothing = true;  // is measured
        for (const StabilityPoint& p : c.points) {
            EXPECT_TRUE(std::isfinite(p.error) && p.bound > 0) << c.operation << c.stress;
            nothing = nothing && p.error == 0;
        }
        EXPECT_FALSE(nothing) << c.operation << " over " << c.stress;
        // A bound of a thousand times the error would hold for any formula.
        EXPECT_GT(c.worst().share, 1e-3) << c.operation << " over " << c.stress;
    }
}

}  // namespace
}  // namespace tvsgs
