// A state in parts is that of one process, divided.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "comm/state_parts.h"
#include "support/random_gaussians.h"
#include "support/thread_ranks.h"

namespace tvsgs {
namespace {

using test::on_ranks;
using test::ThreadRank;

/// Splats that all hold, moments of a part of them, and a number.
struct Kept {
    Gaussians<Cpu> splats;
    Buffer<Vec3f, Cpu> moments;  // two planes of the part
    Buffer<float, Cpu> nothing;
    int count = 0, none = 0, number = 0;

    void visit(StateVisitor<Cpu>& visit) {
        visit_state(visit, "splats.", splats);
        visit.part("moments", moments, count, 2);
        visit.part("nothing", nothing, none);
        visit.value("number", number);
    }
};

Kept made(int count, Part own) {
    Kept kept;
    copy(test::random_gaussians(count, 7, 0.1, 1), kept.splats);
    kept.count = count, kept.number = 4711;
    for (int p = 0; p < 2; ++p) kept.moments.resize(static_cast<std::size_t>(2 * own.size()));
    for (int p = 0; p < 2; ++p)
        for (int i = own.begin; i < own.end; ++i)
            kept.moments[static_cast<std::size_t>(p * own.size() + i - own.begin)] = {
                static_cast<float>(i), static_cast<float>(p), 0.5f};
    return kept;
}

void expect_same(const State& a, const State& b) {
    ASSERT_EQ(a.arrays.size(), b.arrays.size());
    for (std::size_t i = 0; i < a.arrays.size(); ++i) {
        const StateArray &x = a.arrays[i], &y = b.arrays[i];
        EXPECT_EQ(x.name, y.name);
        EXPECT_EQ(x.real, y.real);
        ASSERT_EQ(x.count(), y.count()) << x.name;
        EXPECT_TRUE(x.bytes.size() == 0 ||
                    std::memcmp(x.bytes.data(), y.bytes.data(), x.bytes.size()) == 0)
            << x.name;
    }
}

State saved(Kept kept, Communicator* peers) {
    State state;
    StateVisitor<Cpu> visitor(state, state_parts(peers));
    kept.visit(visitor);
    return state;
}

TEST(StateParts, AreTheWholeDivided) {
    for (const int count : {3, 130, 1000}) {
        const State one = saved(made(count, {0, count}), nullptr);
        EXPECT_FALSE(one.in_parts);
        for (const int ranks : {2, 4})
            on_ranks(ranks, [&](ThreadRank* peers) {
                const Part own = own_part(peers, count);
                const State part = saved(made(count, own), peers);
                EXPECT_EQ(part.get("moments", 12).count(),
                          static_cast<std::size_t>(2 * own.size()));
                EXPECT_EQ(part.get("splats.sh", 12).count(),
                          static_cast<std::size_t>(4 * own.size()));
                const State whole = test::whole_state(peers, part);
                if (peers->rank() == 0)
                    expect_same(whole, one);
                else
                    EXPECT_TRUE(whole.arrays.empty());
                // From their parts, and from the whole.
                for (const State* from : {&part, &one}) {
                    Kept loaded;
                    StateVisitor<Cpu> visitor(*from, state_parts(peers));
                    loaded.visit(visitor);
                    EXPECT_EQ(loaded.count, count);
                    EXPECT_EQ(loaded.none, 0);
                    expect_same(saved(std::move(loaded), peers), part);
                }
            });
    }
}

TEST(StateParts, NameWhatIsNotFiniteAsTheWholeDoes) {
    constexpr int kCount = 300;
    on_ranks(3, [](ThreadRank* peers) {
        const Part own = own_part(peers, kCount);
        const auto found = [&](std::vector<std::pair<int, int>> at) {  // plane, splat
            Kept kept = made(kCount, own);
            for (const auto& [plane, splat] : at)
                if (own.holds(splat))
                    kept.moments[static_cast<std::size_t>(plane * own.size() + splat - own.begin)]
                        .y = NAN;
            return find_not_finite(peers, saved(std::move(kept), peers));
        };
        EXPECT_FALSE(found({}).has_value());
        const auto one = found({{1, 250}});
        ASSERT_TRUE(one.has_value());
        EXPECT_EQ(one->array, "moments");
        EXPECT_EQ(one->element, kCount + 250u);
        const auto first = found({{1, 2}, {0, 290}, {0, 120}});
        ASSERT_TRUE(first.has_value());
        EXPECT_EQ(first->element, 120u);
    });
}

}  // namespace
}  // namespace tvsgs
