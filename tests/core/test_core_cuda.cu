// CUDA versions of the core: the same random numbers, loops and sums as on the CPU.
#include <gtest/gtest.h>

#include <cmath>

#include "core/device/cuda_device.h"
#include "core/device/morton.h"
#include "core/device/parallel.h"
#include "core/math/rng.h"
#include "core/morton_cases.h"

namespace tvsgs {
namespace {

class CoreCuda : public testing::TestWithParam<int> {
protected:
    void SetUp() override {
        if (cuda_device_count() == 0) GTEST_SKIP() << "no usable GPU";
    }
};

struct DrawBody {
    Span<Random4> bits;
    Span<Vec3f> normals;

    TVSGS_HD void operator()(int i) const {
        bits[i] =
            random4(0x123456789abcdefull, RandomStream::test, static_cast<std::uint64_t>(i), 3);
        normals[i] = normal3(bits[i]);
    }
};

TEST_P(CoreCuda, SameDraws) {
    const int count = GetParam();
    Buffer<Random4, Cpu> bits(count);
    Buffer<Vec3f, Cpu> normals(count);
    parallel_for(Cpu{}, count, DrawBody{bits.span(), normals.span()});
    Buffer<Random4, Cuda> cuda_bits(count);
    Buffer<Vec3f, Cuda> cuda_normals(count);
    parallel_for(Cuda{}, count, DrawBody{cuda_bits.span(), cuda_normals.span()});
    const auto from_cuda_bits = to_host(cuda_bits);
    const auto from_cuda_normals = to_host(cuda_normals);
    for (int i = 0; i < count; ++i) {
        for (int k = 0; k < 4; ++k) ASSERT_EQ(from_cuda_bits[i].v[k], bits[i].v[k]) << i;
        // log, sin and cos differ by a few units in the last place; values reach 6.
        for (int c = 0; c < 3; ++c) ASSERT_NEAR(from_cuda_normals[i][c], normals[i][c], 5e-6f) << i;
    }
}

struct Term {
    Span<const float> values;
    TVSGS_HD float operator()(int i) const { return values[i]; }
};

TEST_P(CoreCuda, SameSums) {
    const int count = GetParam();
    std::vector<float> values(count);
    double size = 0;
    for (int i = 0; i < count; ++i) {
        values[i] = std::sin(static_cast<float>(i)) * std::exp(static_cast<float>(i % 30) - 15);
        size += std::abs(static_cast<double>(values[i]));
    }
    const auto host = to_device<Cpu>(values);
    const auto device = to_device<Cuda>(values);
    Buffer<double, Cpu> partial(kSumBlocks);
    double sum = 0.25;
    add_sum(Cpu{}, count, Term{host.span()}, 0.5, partial.span(), &sum);

    Buffer<double, Cuda> cuda_partial(kSumBlocks);
    const auto sum_on_cuda = [&] {
        auto cuda_sum = to_device<Cuda>(std::vector<double>{0.25});
        add_sum(Cuda{}, count, Term{device.span()}, 0.5, cuda_partial.span(), cuda_sum.data());
        return to_host(cuda_sum)[0];
    };
    const double first = sum_on_cuda();
    EXPECT_NEAR(first, sum, 1e-13 * (1 + size));  // double rounding in another order
    EXPECT_EQ(sum_on_cuda(), first) << "sums must not vary from run to run";
}

TEST_P(CoreCuda, SameMortonOrder) {
    for (const std::string& kind : test::morton_clouds()) {
        const std::vector<Vec3f> points = test::morton_cloud(kind, GetParam());
        const auto on_device = to_device<Cuda>(points);
        Buffer<int, Cpu> order;
        morton_order(Span<const Vec3f>{points.data(), points.size()}, order);
        Buffer<int, Cuda> cuda_order;
        morton_order(on_device.span(), cuda_order);
        EXPECT_EQ(to_host(cuda_order), to_host(order)) << kind;
    }
}

INSTANTIATE_TEST_SUITE_P(Sizes, CoreCuda, testing::Values(0, 1, 31, 257, 1000003));

TEST(CoreCudaBuffer, CopiesThereAndBack) {
    if (cuda_device_count() == 0) GTEST_SKIP() << "no usable GPU";
    const std::int64_t before = memory_use(Cuda{}).current_bytes;
    {
        const auto there = to_device<Cuda>(std::vector<int>{3, 1, 4, 1, 5});
        Buffer<int, Cuda> second;
        copy(there, second);
        EXPECT_EQ(to_host(second), (std::vector<int>{3, 1, 4, 1, 5}));
        second.fill_zero();
        EXPECT_EQ(to_host(second), std::vector<int>(5, 0));
        EXPECT_EQ(memory_use(Cuda{}).current_bytes, before + 40);
    }
    EXPECT_EQ(memory_use(Cuda{}).current_bytes, before);
}

}  // namespace
}  // namespace tvsgs
