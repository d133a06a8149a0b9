// The order in which training draws views.
#include <set>

#include "optim/loop/train_loop.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

TEST(ViewSampler, EveryViewOncePerRoundInChangingOrder) {
    ViewSampler sampler(7, 3), same(7, 3), other(7, 4);
    std::set<std::vector<int>> orders;
    bool differs = false;
    for (int round = 0; round < 20; ++round) {
        std::vector<int> order;
        for (int i = 0; i < 7; ++i) {
            const int iteration = 7 * round + i + 1;
            order.push_back(sampler.view(iteration));
            EXPECT_EQ(same.view(iteration), order.back());
            differs |= other.view(iteration) != order.back();
        }
        EXPECT_EQ(std::set<int>(order.begin(), order.end()).size(), 7u) << "round " << round;
        EXPECT_GE(*std::min_element(order.begin(), order.end()), 0);
        EXPECT_LT(*std::max_element(order.begin(), order.end()), 7);
        orders.insert(order);
    }
    EXPECT_GT(orders.size(), 15u) << "of 5040 orders, twenty draws hardly repeat";
    EXPECT_TRUE(differs) << "another seed, another order";
}

TEST(ViewSampler, EveryViewIsFirstEquallyOften) {
    ViewSampler sampler(5, 0);
    int first[5] = {};
    for (int round = 0; round < 2000; ++round)
        for (int i = 0; i < 5; ++i) {
            const int view = sampler.view(5 * round + i + 1);
            if (i == 0) ++first[view];
        }
    for (int count : first) EXPECT_NEAR(count, 400, 90);  // five standard deviations of 18
}

TEST(ShDegree, RisesUpToTheStoredOne) {
    const ModelOptions model{.sh_degree = 2, .sh_every = 1000};
    EXPECT_EQ(sh_degree_at(model, 999), 0);
    EXPECT_EQ(sh_degree_at(model, 1000), 1);
    EXPECT_EQ(sh_degree_at(model, 2000), 2);
    EXPECT_EQ(sh_degree_at(model, 9000), 2);
}

}  // namespace
}  // namespace tvsgs
