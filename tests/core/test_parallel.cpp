#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "core/device/parallel_lists.h"
#include "core/device/threads.h"

namespace tvsgs {
namespace {

// Terms of very different size: another order of summation would change the last bits.
float term(int i) {
    return std::sin(static_cast<float>(i)) * std::exp(static_cast<float>(i % 30) - 15);
}

double sum_with(int threads, int count) {
    set_thread_count(threads);
    Buffer<double, Cpu> partial(kSumBlocks);
    double sum = 0.25;
    add_sum(Cpu{}, count, term, 0.5, partial.span(), &sum);
    return sum;
}

class AddSum : public testing::TestWithParam<int> {
protected:
    const int threads_before_ = thread_count();
    void TearDown() override { set_thread_count(threads_before_); }
};

TEST_P(AddSum, AddsTheScaledSum) {
    double expected = 0, size = 0;
    for (int i = 0; i < GetParam(); ++i) {
        expected += static_cast<double>(term(i));
        size += std::abs(static_cast<double>(term(i)));
    }
    // Rounding of a sum in double in another order.
    EXPECT_NEAR(sum_with(1, GetParam()), 0.25 + 0.5 * expected, 1e-13 * (1 + size));
}

TEST_P(AddSum, IsBitIdenticalForAnyNumberOfThreads) {
    const double one = sum_with(1, GetParam());
    for (const int threads : {2, 3, 8})
        EXPECT_EQ(sum_with(threads, GetParam()), one) << threads << " threads";
}

INSTANTIATE_TEST_SUITE_P(Sizes, AddSum, testing::Values(0, 1, 31, 257, 100000));

TEST(ParallelFor, VisitsEveryIndexOnce) {
    for (const int count : {0, 1, 31, 257, 10000}) {
        std::vector<int> visits(count), heavy_visits(count);
        parallel_for(Cpu{}, count, [&](int i) { ++visits[i]; });
        parallel_for_heavy(Cpu{}, count, [&](int i) { ++heavy_visits[i]; });
        EXPECT_EQ(visits, std::vector<int>(count, 1));
        EXPECT_EQ(heavy_visits, std::vector<int>(count, 1));
    }
}

TEST(ParallelLists, PartsAreTheWholeInItsOrder) {
    for (const std::size_t count : {0u, 1u, 63u, 64u, 65u, 1000u}) {
        std::vector<int> times(count);
        for_parts(count, [&](std::size_t part, std::size_t first, std::size_t last) {
            ASSERT_LE(first, last);
            ASSERT_LE(last, count);
            ASSERT_LT(part, std::size_t{kListParts});
            for (std::size_t i = first; i < last; ++i) ++times[i];
        });
        EXPECT_EQ(times, std::vector<int>(count, 1)) << count;
    }
}

TEST(ParallelLists, AreSorted) {
    for (const std::size_t count : {0u, 1u, 63u, 64u, 65u, 10000u}) {
        std::vector<std::pair<int, int>> values;
        for (std::size_t i = 0; i < count; ++i)
            values.emplace_back(static_cast<int>(i * 7919 % 101), static_cast<int>(count - i));
        auto expected = values;
        std::sort(expected.begin(), expected.end());
        sort_in_parallel(values, std::less<>());
        EXPECT_EQ(values, expected) << count;
    }
}

TEST(ParallelLists, AreThoseOfOneThread) {
    for (const std::size_t count : {0u, 1u, 65u, 4097u}) {
        const auto is_in = [](std::size_t i) { return i % 7 == 3 || i % 64 == 0; };
        std::vector<int> expected;
        std::vector<double> values(count), some;
        for (std::size_t i = 0; i < count; ++i) {
            values[i] = 0.5 * static_cast<double>(i);
            if (is_in(i)) expected.push_back(static_cast<int>(i)), some.push_back(values[i]);
        }
        const std::vector<int> numbers = indices_where(count, is_in);
        EXPECT_EQ(numbers, expected) << count;
        EXPECT_EQ(taken(values, numbers), some) << count;
    }
}

}  // namespace
}  // namespace tvsgs
