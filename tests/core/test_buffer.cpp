#include <gtest/gtest.h>

#include <numeric>

#include "core/device/buffer.h"

namespace tvsgs {
namespace {

TEST(Buffer, ShrinkingKeepsMemoryAndContents) {
    Buffer<int, Cpu> buffer(100);
    std::iota(buffer.data(), buffer.data() + 100, 0);
    const int* data = buffer.data();
    buffer.resize(10);
    EXPECT_EQ(buffer.size(), 10u);
    buffer.resize(100);
    EXPECT_EQ(buffer.data(), data);
    EXPECT_EQ(buffer[99], 99);
}

TEST(Buffer, GrowingLeavesRoomToGrowAgain) {
    Buffer<float, Cpu> buffer(100);
    buffer.resize(101);  // capacity is now 126
    const float* data = buffer.data();
    buffer.resize(126);
    EXPECT_EQ(buffer.data(), data);
}

TEST(Buffer, FillZeroClearsEverything) {
    Buffer<double, Cpu> buffer(257);
    for (int i = 0; i < 257; ++i) buffer[i] = i + 1;
    buffer.fill_zero();
    EXPECT_EQ(std::accumulate(buffer.data(), buffer.data() + 257, 0.0), 0);
}

TEST(Buffer, CopiesByNameAndMovesOwnership) {
    Buffer<int, Cpu> from = to_device<Cpu>(std::vector<int>{1, 2, 3});
    Buffer<int, Cpu> to;
    copy(from, to);
    from[0] = 7;
    EXPECT_EQ(to_host(to), (std::vector<int>{1, 2, 3}));
    const int* data = from.data();
    const Buffer<int, Cpu> moved = std::move(from);
    EXPECT_EQ(moved.data(), data);
    EXPECT_EQ(moved[0], 7);
}

TEST(Buffer, EmptyBuffersAreHarmless) {
    Buffer<int, Cpu> buffer, other;
    buffer.resize(0);
    buffer.fill_zero();
    copy(buffer, other);
    EXPECT_TRUE(other.empty());
    EXPECT_TRUE(other.span().empty());
}

TEST(Buffer, MemoryUseFollowsAllocations) {
    const MemoryUse before = memory_use(Cpu{});
    {
        Buffer<char, Cpu> buffer(1 << 20);
        EXPECT_EQ(memory_use(Cpu{}).current_bytes, before.current_bytes + (1 << 20));
    }
    EXPECT_EQ(memory_use(Cpu{}).current_bytes, before.current_bytes);
    EXPECT_GE(memory_use(Cpu{}).peak_bytes, before.current_bytes + (1 << 20));
}

}  // namespace
}  // namespace tvsgs
