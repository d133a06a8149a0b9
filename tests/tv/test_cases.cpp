// Tests agreement with the stored cases of the float64 oracle, for each device and both precisions.
#include <cstdio>
#include <filesystem>

#include "apps/bench/case.h"
#include "support/test_data.h"
#include "tv/tv_support.h"

namespace tvsgs::test {
namespace {

std::vector<std::string> case_files() {
    std::vector<std::string> files;
    for (const auto& entry : std::filesystem::directory_iterator(test_data("tensor_voting/cases")))
        files.push_back(entry.path().string());
    std::sort(files.begin(), files.end());
    return files;
}

template <class Device>
class TvCases : public ::testing::Test {};
TYPED_TEST_SUITE(TvCases, Devices);

TYPED_TEST(TvCases, AgreeWithTheOracle) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    const std::vector<std::string> files = case_files();
    ASSERT_EQ(files.size(), 16u);
    for (const std::string& file : files)
        for (const auto precision :
             {VotePrecision::single_precision, VotePrecision::double_precision}) {
            SCOPED_TRACE(file);
            VotingCase stored = read_voting_case(file);
            stored.options.precision = precision;
            const CaseComparison result = compare_case_on(stored, TypeParam{});
            std::printf("%-24s", std::filesystem::path(file).stem().c_str());
            for (const CaseQuantity& q : result.quantities)
                if (q.bound > 0) std::printf("  %s %.2g", q.name, q.largest);
            std::printf("  excused %d\n", result.excused);
            for (const std::string& fault : result.faults()) ADD_FAILURE() << fault;
        }
}

}  // namespace
}  // namespace tvsgs::test
