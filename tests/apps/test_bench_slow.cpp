// Large new cases of the oracle: about half a minute in Python.
#include "apps/test_bench.h"

namespace tvsgs {
namespace {

TEST_F(Bench, AgreesWithTheOracleOnLargeFreshCases) {
    if (const std::string why = no_oracle(); !why.empty()) GTEST_SKIP() << why;
    expect_agreement("large_k", "--shape sphere --n 600 --k 100 --seed 21");
    expect_agreement("many", "--shape planes --n 1500 --k 8 --seed 22 --vote-map unit");
    expect_agreement("clusters", "--shape cluster --n 1000 --k 24 --seed 23 --mode per_splat");
}

}  // namespace
}  // namespace tvsgs
