// Several processes at one training, as threads: what they share, and that all end with the same
// splats.
#include <gtest/gtest.h>

#include <cstring>

#include "optim/train_state.h"
#include "thread_ranks.h"
#include "training_scene.h"

namespace tvsgs {
namespace {

using test::on_ranks;

TEST(Communicator, PartsComeInTheOrderOfTheRanks) {
    for (const int size : {1, 2, 3})
        on_ranks(size, [size](Communicator& peers) {
            Buffer<float, Cpu> values, none;
            copy(std::vector<float>{static_cast<float>(peers.rank()), 0.25f}, values);
            const std::vector<float> all = gather_ranks(&peers, values);
            ASSERT_EQ(all.size(), 2u * static_cast<std::size_t>(size));
            for (int r = 0; r < size; ++r) {
                EXPECT_EQ(all[static_cast<std::size_t>(2 * r)], static_cast<float>(r));
                EXPECT_EQ(all[static_cast<std::size_t>(2 * r + 1)], 0.25f);
            }
            mean_over_ranks<float>(&peers, values);
            EXPECT_FLOAT_EQ(values[0], static_cast<float>(size - 1) / 2);
            EXPECT_EQ(values[1], 0.25f);
            mean_over_ranks<float>(&peers, none);
            EXPECT_TRUE(none.empty());
        });
    Buffer<float, Cpu> alone;
    copy(std::vector<float>{3}, alone);
    EXPECT_EQ(gather_ranks<float>(nullptr, alone), std::vector<float>{3});
}

TEST(ViewSampler, RanksShareEachRound) {
    ViewSampler whole(5, 3), a(5, 3, 0, 2), b(5, 3, 1, 2);
    for (int step = 0; step < 12; ++step) {
        ViewSampler resumed(5, 3, 1, 2);
        resumed.skip_to(step);
        EXPECT_EQ(resumed.peek(), b.peek()) << step;
        EXPECT_EQ(a.next(), whole.next()) << step;
        EXPECT_EQ(b.next(), whole.next()) << step;
    }
}

TrainOptions options_for_ranks(int iterations) {
    TrainOptions options = test::everything_on(iterations);
    options.loss.photometric.exposure = ExposureModel::none;
    options.densify.max_gaussians = 250;
    return options;
}

/// Adam's first moments after one step: a tenth of its gradient.
Gaussians<Cpu> first_moments(const Scene& scene, Communicator* peers) {
    TrainOptions options = options_for_ranks(2);
    Gaussians<Cpu> moments;
    TrainCallbacks callbacks;
    callbacks.peers = peers;
    callbacks.save_due = [](int done) { return done == 1; };
    callbacks.on_save = [&](int, const SharedState& state) {
        StateVisitor<Cpu> visit(*state);
        visit_state(visit, "adam.m.", moments);
    };
    train<Cpu>(scene, options, callbacks);
    return moments;
}

TEST(Ranks, TakeTheMeanOfTheirGradients) {
    const Scene scene = test::rendered_scene();
    const int views = static_cast<int>(scene.train.size());
    ViewSampler sampler(views, 0);
    std::vector<Gaussians<Cpu>> alone;
    for (int r = 0; r < 2; ++r) {
        Scene one = scene;  // whose first view is the one that rank r draws
        std::swap(one.train[static_cast<std::size_t>(ViewSampler(views, 0).next())],
                  one.train[static_cast<std::size_t>(sampler.next())]);
        alone.push_back(first_moments(one, nullptr));
    }
    on_ranks(2, [&](Communicator& peers) {
        const Gaussians<Cpu> both = first_moments(scene, &peers);
        ASSERT_EQ(both.size(), alone[0].size());
        double off = 0, size = 0, apart = 0;
        for (std::size_t i = 0; i < both.means.size(); ++i) {
            const Vec3f mean = 0.5f * (alone[0].means[i] + alone[1].means[i]);
            off += static_cast<double>(norm(both.means[i] - mean));
            apart += static_cast<double>(norm(alone[0].means[i] - alone[1].means[i]));
            size += static_cast<double>(norm(mean));
        }
        EXPECT_LT(off, 1e-5 * size);
        EXPECT_GT(apart, 0.1 * size) << "the views differ";
    });
}

TEST(Ranks, EndWithTheSameSplats) {
    const Scene scene = test::rendered_scene();
    const TrainOptions options = options_for_ranks(47);
    std::vector<Gaussians<Cpu>> ends(2);
    std::vector<std::vector<double>> losses(2);
    on_ranks(2, [&](Communicator& peers) {
        const auto rank = static_cast<std::size_t>(peers.rank());
        TrainCallbacks callbacks;
        callbacks.peers = &peers;
        callbacks.report_due = [](int) { return true; };
        callbacks.on_report = [&](const TrainReport& r) { losses[rank].push_back(r.loss); };
        ends[rank] = train<Cpu>(scene, options, callbacks);
    });
    EXPECT_EQ(losses[0], losses[1]);
    EXPECT_EQ(losses[0].size(), 47u);
    ASSERT_GT(ends[0].size(), static_cast<int>(scene.points.positions.size())) << "it grew";
    for_each_array(
        [](const SplatArray& array, const auto& a, const auto& b) {
            ASSERT_EQ(a.size(), b.size()) << array.name;
            EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(*a.data())), 0)
                << array.name;
        },
        ends[0], ends[1]);
}

}  // namespace
}  // namespace tvsgs
