// Large new cases of the oracle: several seconds in Python.
#include "apps/test_bench.h"

namespace tvsgs {
namespace {

TEST_F(Bench, AgreesWithTheOracleOnLargeFreshCases) {
    if (const std::string why = no_oracle(); !why.empty()) GTEST_SKIP() << why;
    expect_agreement({{"large_k", "--shape sphere --n 400 --k 100 --seed 21"},
                      {"many", "--shape planes --n 1100 --k 8 --seed 22 --vote-map unit"},
                      {"clusters", "--shape cluster --n 600 --k 24 --seed 23 --mode per_splat"}});
}

}  // namespace
}  // namespace tvsgs
