// What several processes ask each other for, and how splats are dealt to them.
#include <gtest/gtest.h>

#include <set>
#include <vector>

#include "optim/adam.h"
#include "optim/splat_order.h"
#include "support/thread_ranks.h"

namespace tvsgs {
namespace {

using test::on_ranks;

TEST(DealtOrder, GivesEachPartSomeOfAllNeighbourhoods) {
    for (const int count : {0, 1, 1023, 1024, 1025, 32768, 32769, 33000, 65535, 100003}) {
        std::set<int> places;
        for (int i = 0; i < count; ++i) places.insert(DealtOrder{count}(i));
        EXPECT_EQ(places.size(), static_cast<std::size_t>(count));
        if (count > 0) {
            EXPECT_EQ(*places.rbegin(), count - 1);
        }
    }
    constexpr int kCount = 300003;
    for (const int ranks : {2, 3, 4}) {
        std::vector<int> seen(static_cast<std::size_t>(ranks));
        for (int r = 0; r < ranks; ++r)
            for (int i = part_of(kCount, r, ranks).begin; i < part_of(kCount, r, ranks).end; ++i) {
                const int old = DealtOrder{kCount}(i);
                seen[static_cast<std::size_t>(r)] += 100000 <= old && old < 200000;
            }
        for (const int here : seen) EXPECT_NEAR(here, 100000 / ranks, 2000) << ranks;
    }
    for (int i = 1; i < kCount; ++i) {  // runs are whole
        const int before = DealtOrder{kCount}(i - 1), run_end = DealtOrder::kDealt - 1;
        if (before % DealtOrder::kDealt != run_end && before != kCount - 1) {
            ASSERT_EQ(DealtOrder{kCount}(i), before + 1);
        }
    }
}

/// Each asks for what it sees, one for nothing; where one sees much, all get all.
TEST(AskedHarmonics, AreThoseOfTheirOwners) {
    constexpr int kCount = 300000, kMoved = 4;
    for (const int ranks : {2, 3})
        for (const double share : {0.0, 0.1, 0.6})
            on_ranks(ranks, [&](test::ThreadRank* peers) {
                const int own_rank = peers->rank();
                const Part own = own_part(peers, kCount);
                Gaussians<Cpu> g;
                resize(g, kCount, 2);
                const auto value = [](int i, int k) {
                    return Vec3f{static_cast<float>(i), static_cast<float>(k), 1};
                };
                const auto same = [](Vec3f a, Vec3f b) {
                    return a.x == b.x && a.y == b.y && a.z == b.z;
                };
                std::vector<float> radii(kCount, 0);
                std::vector<std::uint32_t> before{0};
                for (int i = 0; i < kCount; ++i) {
                    const bool seen = (i + 31 * own_rank) % 1000 < 1000 * share;
                    if (own_rank > 0 && seen) radii[static_cast<std::size_t>(i)] = 1;
                    before.push_back(before.back() + (own_rank > 0 && seen));
                    for (int k = 0; k < sh_count(2); ++k)
                        g.sh[static_cast<std::size_t>(k * kCount + i)] =
                            own.holds(i) ? value(i, k) : Vec3f{-1, -1, -1};
                }
                const SplatPlaces places{{radii.data(), radii.size()},
                                         {before.data(), before.size()}};
                const auto count_current = [&] {
                    int current = 0;
                    for (int i = 0; i < kCount; ++i) {
                        int right = 0;
                        for (int k = 0; k < kMoved; ++k)
                            right +=
                                same(g.sh[static_cast<std::size_t>(k * kCount + i)], value(i, k));
                        EXPECT_TRUE(right == 0 || right == kMoved);
                        const bool seen = radii[static_cast<std::size_t>(i)] > 0;
                        EXPECT_TRUE(right > 0 || !(seen || own.holds(i))) << i;
                        current += right > 0;
                    }
                    return current;
                };
                AskedHarmonics<Cpu> asked;
                const auto ask = [&] { asked.ask(*peers, g, own_rank == 0 ? nullptr : &places); };
                ask();
                EXPECT_EQ(peers->gathers, 0) << "nothing has moved";
                asked.step_done(kMoved);
                ask();
                const std::size_t dealt = peers->dealt;
                const int others = kCount - own.size();
                const double expected = share > 0.25 ? others : own_rank > 0 ? share * others : 0;
                // The own part begins and ends among a thousand, of which the first ones are seen.
                EXPECT_NEAR(count_current() - own.size(), expected, 100);
                ask();  // for the same photograph
                EXPECT_EQ(peers->dealt, dealt);
                asked.begin_photograph();
                ask();
                EXPECT_EQ(peers->dealt > dealt, share == 0.1);
                asked.catch_up(*peers, g);
                EXPECT_EQ(count_current(), kCount);
                const std::size_t gathered = peers->gathered;
                asked.catch_up(*peers, g);
                EXPECT_EQ(peers->gathered, gathered) << "all have all";
            });
}

}  // namespace
}  // namespace tvsgs
