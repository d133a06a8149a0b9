// Several photographs in a step, and several processes (here: threads) at one training.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <set>

#include "optim/batch.h"
#include "support/numeric.h"
#include "support/thread_ranks.h"
#include "training_scene.h"

namespace tvsgs {
namespace {

using test::on_ranks;

TEST(ViewSampler, AStepLooksAtDifferentViews) {
    for (const int batch : {1, 2, 3, 5}) {
        ViewSampler sampler(7, 3, batch);
        std::set<int> seen;
        for (int step = 0; step < 40; ++step) {
            std::set<int> views;
            for (int b = 1; b <= batch; ++b) views.insert(sampler.view(step * batch + b));
            EXPECT_EQ(views.size(), static_cast<std::size_t>(batch));
            seen.merge(views);
        }
        EXPECT_EQ(seen.size(), 7u) << "none is left out for good";
        ViewSampler resumed(7, 3, batch);
        EXPECT_EQ(resumed.view(33), sampler.view(33));
    }
}

TEST(Periods, EventsAreDueWhereTheyFallAmongTheIterationsOfAStep) {
    for (const int batch : {1, 2, 4, 7})
        for (const int period : {1, 3, 10})
            for (int step = batch; step < 60; step += batch) {
                bool due = false;
                for (int iteration = step - batch + 1; iteration <= step; ++iteration)
                    due |= iteration % period == 0;
                EXPECT_EQ(passes_multiple(step, batch, period), due) << step << " " << batch;
            }
}

TEST(Adam, MovesItsMomentsByTheBatchAsOneByOne) {
    for (const int batch : {1, 2, 4, 10}) {
        const AdamDecay<float> decay = adam_decay(batch);
        EXPECT_NEAR(decay.beta1 + decay.share1, 1, 1e-7f);
        EXPECT_NEAR(decay.beta1, std::pow(0.9, batch), 1e-7);
        EXPECT_NEAR(decay.share2, 1 - std::pow(0.999, batch), 1e-8);
        EXPECT_NEAR(decay.eps, 1e-15 / std::sqrt(batch), 1e-21);
        EXPECT_FLOAT_EQ(adam_scale(1, 3, batch).step, adam_scale(1, 3 * batch).step);
        EXPECT_FLOAT_EQ(adam_scale(1, 3, batch).root, adam_scale(1, 3 * batch).root);
    }
    const AdamDecay<float> one = adam_decay(1);
    EXPECT_EQ(one.beta1, 0.9f);
    EXPECT_EQ(one.share2, 0.001f);
}

TrainOptions options_of_batch(int iterations, int batch) {
    TrainOptions options = test::everything_on(iterations);
    options.comm.batch = batch;
    options.densify.max_gaussians = 250;
    return options;
}

/// As test::rendered_scene(), with twice as many views: each again from a little farther left.
Scene six_views() {
    Scene scene = test::rendered_scene();
    for (int i = 0; i < 3; ++i) {
        View view;
        view.camera = scene.train[static_cast<std::size_t>(i)].camera;
        view.camera.camera_from_world.t += Vec3f{0.05f, 0.02f, 0};
        view.photo = ImageU8(40, 30, 3);
        view.photo.pixels = scene.train[static_cast<std::size_t>(i)].photo.pixels;
        scene.train.push_back(std::move(view));
    }
    return scene;
}

/// With splats behind all cameras.
Scene with_far(Scene scene, int far) {
    for (int i = 0; i < far; ++i)
        scene.points.positions.push_back({1e3f + static_cast<float>(i), 0, -1e4f});
    return scene;
}

/// Adam's first moments after the first step: shares of its gradient.
Gaussians<Cpu> first_moments(const Scene& scene, TrainOptions options, Communicator* peers) {
    Gaussians<Cpu> moments;
    const int batch = options.comm.batch;
    options.iterations = 2 * batch;
    TrainCallbacks callbacks;
    callbacks.peers = peers;
    callbacks.save_due = [batch](int done) { return done == batch; };
    callbacks.on_save = [&](int, const SharedState& state) {
        StateVisitor<Cpu> visit(*state);
        visit_state(visit, "adam.m.", moments);
    };
    train<Cpu>(scene, options, callbacks);
    return moments;
}

TEST(Batch, GoesAlongTheMeanOfTheGradients) {
    const Scene scene = six_views();
    const int views = static_cast<int>(scene.train.size()), batch = 3;
    ViewSampler sampler(views, 0, batch);
    std::vector<Gaussians<Cpu>> alone;
    for (int b = 0; b < batch; ++b) {
        Scene one = scene;  // whose first view is the one that the step looks at
        TrainOptions options = options_of_batch(0, 1);
        std::swap(one.train[static_cast<std::size_t>(ViewSampler(views, 0).view(1))],
                  one.train[static_cast<std::size_t>(sampler.view(b + 1))]);
        // Other views have draws of their own, by iteration.
        options.loss.multi_view_geometry.weight = options.loss.multi_view_ncc.weight = 0;
        alone.push_back(first_moments(one, options, nullptr));
    }
    TrainOptions options = options_of_batch(0, batch);
    options.loss.multi_view_geometry.weight = options.loss.multi_view_ncc.weight = 0;
    const Gaussians<Cpu> all = first_moments(scene, options, nullptr);
    const double share = static_cast<double>(adam_decay(batch).share1);
    for_each_array(
        [&](const SplatArray& array, const auto& mean, const auto& a, const auto& b,
            const auto& c) {
            const auto floats = [](const auto& values) {
                return reinterpret_cast<const float*>(values.data());
            };
            double off = 0, size = 0, apart = 0;
            for (std::size_t i = 0; i < mean.size() * sizeof(*mean.data()) / sizeof(float); ++i) {
                const double x = static_cast<double>(floats(a)[i]) / 0.1,
                             y = static_cast<double>(floats(b)[i]) / 0.1,
                             z = static_cast<double>(floats(c)[i]) / 0.1,
                             expected = (x + y + z) / 3;
                off += std::abs(static_cast<double>(floats(mean)[i]) / share - expected);
                size += std::abs(expected), apart += std::abs(x - y);
            }
            EXPECT_LE(off, 2e-6 * size) << array.name;
            if (array.name == std::string("means")) {
                EXPECT_GT(apart, 0.1 * size) << "the views differ";
            }
        },
        all, alone[0], alone[1], alone[2]);
}

struct End {
    Gaussians<Cpu> splats;
    SharedState state;  // after 24 iterations, or 28 of a training that was resumed
    std::vector<double> losses;
};

/// A training that goes on from `start`, on one of the ranks.
template <class Device = Cpu>
End train_on(Communicator* peers,
             const Scene& scene,
             const TrainOptions& options,
             const SharedState& start = nullptr) {
    End end;
    TrainCallbacks callbacks;
    callbacks.peers = peers;
    callbacks.report_due = [](int) { return true; };
    callbacks.on_report = [&](const TrainReport& r) { end.losses.push_back(r.loss); };
    callbacks.save_due = [&](int done) { return done == (start ? 28 : 24); };
    callbacks.on_save = [&](int, const SharedState& state) { end.state = state; };
    callbacks.records_at_a_time = 20;
    copy(train<Device>(scene, options, callbacks, {}, start), end.splats);
    if (end.state) end.state = std::make_shared<State>(test::whole_state(peers, *end.state));
    return end;
}

void expect_same_bits(const Gaussians<Cpu>& a, const Gaussians<Cpu>& b, const std::string& what) {
    for_each_array(
        [&](const SplatArray& array, const auto& x, const auto& y) {
            ASSERT_EQ(x.size(), y.size()) << array.name << ", " << what;
            EXPECT_EQ(std::memcmp(x.data(), y.data(), x.size() * sizeof(*x.data())), 0)
                << array.name << ", " << what;
        },
        a, b);
}

void expect_same_arrays(const State& a, const State& b) {
    ASSERT_EQ(a.arrays.size(), b.arrays.size());
    for (std::size_t i = 0; i < a.arrays.size(); ++i) {
        ASSERT_EQ(a.arrays[i].name, b.arrays[i].name);
        ASSERT_EQ(a.arrays[i].bytes.size(), b.arrays[i].bytes.size()) << a.arrays[i].name;
        EXPECT_EQ(std::memcmp(a.arrays[i].bytes.data(), b.arrays[i].bytes.data(),
                              a.arrays[i].bytes.size()),
                  0)
            << a.arrays[i].name;
    }
}

class Ranks : public testing::TestWithParam<const char*> {};

/// Growth, trims, resets, votes, other views and exposures; every array of the checkpoint. Splats
/// are some 200, so parts differ in size, and records go in several exchanges.
TEST_P(Ranks, HaveTheBitsOfOneProcess) {
    const Scene scene = six_views();
    TrainOptions options = options_of_batch(61, 4);
    options.backbone = GetParam();
    if (options.backbone != "ewa") options.loss.flatten.weight = 0;
    if (options.backbone == "ewa") {
        options.cameras.refine = true;
        options.cameras.start = 8;
    } else if (options.backbone == "rade") {
        options.densify.rule = GrowthRule::quantile;
        options.tv.lists = ListStorage::compact;
    } else {
        options.tv.strength = VoteStrength::literal;
        options.densify.spare_covered = 0.3f;
        options.model.sh_degree = 1;
    }
    const End one = train_on(nullptr, scene, options);
    ASSERT_GT(one.splats.size(), static_cast<int>(scene.points.positions.size())) << "it grew";
    ASSERT_EQ(one.losses.size(), 16u);
    for (const int ranks : {2, 3, 4}) {
        std::vector<End> ends(static_cast<std::size_t>(ranks));
        on_ranks(ranks, [&](test::ThreadRank* peers) {
            ends[static_cast<std::size_t>(peers->rank())] = train_on(peers, scene, options);
        });
        for (const End& end : ends) {
            EXPECT_EQ(end.losses, one.losses) << ranks;
            expect_same_bits(end.splats, one.splats, str(ranks, " ranks"));
        }
        expect_same_arrays(*ends[0].state, *one.state);
    }
    const End resumed = train_on(nullptr, scene, options, one.state);
    expect_same_bits(resumed.splats, one.splats, "resumed by one");
    for (const int ranks : {2, 3})
        on_ranks(ranks, [&](test::ThreadRank* peers) {
            const End end = train_on(peers, scene, options, one.state);
            expect_same_bits(end.splats, one.splats, str("resumed by ", ranks));
            if (peers->rank() == 0) expect_same_arrays(*end.state, *resumed.state);
        });
}
INSTANTIATE_TEST_SUITE_P(All, Ranks, testing::Values("ewa", "rade", "surfel"));

TEST(RanksGrowth, ProposeGrowthAsOneDoes) {
    constexpr int kCount = 500;
    test::Random random(5);
    std::vector<GrowthStatistics> statistics;
    std::vector<Vec3f> log_scales;
    for (int i = 0; i < kCount; ++i) {  // the last ones have more to say
        const double more = 1 + 3.0 * i / kCount;
        statistics.push_back({static_cast<float>(random.uniform(0, 1) * more),
                              static_cast<float>(random.uniform(0, 2) * more), 1, 30});
        log_scales.push_back({static_cast<float>(random.uniform(-2, 0)), -3, -3});
    }
    const auto propose = [&](GrowthRule rule, Communicator* peers) {
        const Part own = own_part(peers, kCount);
        Buffer<GrowthStatistics, Cpu> mine;
        copy(std::vector(statistics.begin() + own.begin, statistics.begin() + own.end), mine);
        std::vector<Growth> growth(kCount);
        std::vector<float> score(kCount);
        const auto first = static_cast<std::size_t>(own.begin),
                   size = static_cast<std::size_t>(own.size());
        propose_growth<Cpu>(rule,
                            {mine, {log_scales.data() + first, size}, 1.5f, 4, 0.4f, 20, peers},
                            {growth.data() + first, size}, {score.data() + first, size});
        share_parts(peers, "growth", Cpu{}, growth.data(), kCount);
        share_parts(peers, "growth", Cpu{}, score.data(), kCount);
        return std::pair(growth, score);
    };
    for (const GrowthRule rule : {GrowthRule::thresholds, GrowthRule::quantile}) {
        const auto one = propose(rule, nullptr);
        EXPECT_GT(std::count(one.first.begin(), one.first.end(), Growth::none), kCount / 4);
        EXPECT_GT(std::count(one.first.begin(), one.first.end(), Growth::split), kCount / 10);
        for (const int ranks : {2, 4})
            on_ranks(ranks, [&](test::ThreadRank* peers) { EXPECT_EQ(propose(rule, peers), one); });
    }
}

/// From the last state saved, of which each has its part, and from the start.
TEST(RanksRollBack, ToTheSame) {
    const Scene scene = six_views();
    const TrainOptions options = options_of_batch(41, 4);
    for (const int saved_at : {16, 1000}) {
        const auto run = [&](Communicator* peers) {
            TrainCallbacks callbacks;
            callbacks.peers = peers;
            callbacks.save_due = [&](int done) { return done == saved_at; };
            callbacks.on_save = [](int, const SharedState&) {};
            std::vector<int> back;
            callbacks.on_rollback = [&](int done, const std::string&) { back.push_back(done); };
            callbacks.injected_fault = {
                .step = 28, .group = ParameterGroup::opacities, .splat = 70, .times = 1};
            Gaussians<Cpu> end = train<Cpu>(scene, options, callbacks);
            EXPECT_EQ(back, std::vector<int>{saved_at == 16 ? 16 : 0});
            return end;
        };
        const Gaussians<Cpu> one = run(nullptr);
        on_ranks(3, [&](test::ThreadRank* peers) {
            expect_same_bits(run(peers), one, str("saved at ", saved_at));
        });
    }
}

/// Where only the process that owns the splat has the number that is not finite. Before a look at
/// all parameters is due a loss at fault asks for one.
TEST(RanksRollBack, ForAHarmonicThatOneOfThemOwns) {
    const Scene scene = six_views();
    TrainOptions options = options_of_batch(41, 4);
    options.densify.from = 20;
    const auto run = [&](Communicator* peers, bool reports) {
        TrainCallbacks callbacks;
        callbacks.peers = peers;
        callbacks.report_due = [reports](int step) { return reports && step == 8; };
        callbacks.on_report = [](const TrainReport&) {};
        callbacks.injected_fault.step = 4;
        if (reports) callbacks.injected_fault.term = 0;
        std::vector<int> back;
        callbacks.on_rollback = [&](int done, const std::string& what) {
            back.push_back(done);
            EXPECT_NE(what.find("base colour of splat 70 "), std::string::npos) << what;
        };
        if (own_part(peers, static_cast<int>(scene.points.positions.size())).holds(70)) {
            callbacks.injected_fault.group = ParameterGroup::sh_dc;
            callbacks.injected_fault.splat = 70;
            callbacks.injected_fault.times = reports ? 2 : 1;
        }
        Gaussians<Cpu> end = train<Cpu>(scene, options, callbacks);
        EXPECT_EQ(back, std::vector<int>{0});
        return end;
    };
    for (const bool reports : {false, true}) {
        const Gaussians<Cpu> one = run(nullptr, reports);
        on_ranks(3, [&](test::ThreadRank* peers) {
            expect_same_bits(run(peers, reports), one, "rolled back");
        });
    }
}

/// Where some of the ranks have no photograph in the last step, at which the degree rises; resumed
/// there as well.
TEST(RanksLast, AStepThatIsNotFull) {
    const Scene scene = six_views();
    TrainOptions options = options_of_batch(26, 4);
    options.model.sh_every = 26;
    const End one = train_on(nullptr, scene, options);
    for (const int ranks : {3, 4})
        on_ranks(ranks, [&](test::ThreadRank* peers) {
            expect_same_bits(train_on(peers, scene, options).splats, one.splats, "at once");
            const End resumed = train_on(peers, scene, options, one.state);
            expect_same_bits(resumed.splats, one.splats, "resumed");
        });
}

/// Who looks at the splats between two steps sees those of one process, and changes nothing.
TEST(RanksNow, ShowTheSplatsOfOneProcess) {
    const Scene scene = six_views();
    const TrainOptions options = options_of_batch(40, 4);
    const auto run = [&](Communicator* peers) {
        TrainCallbacks callbacks;
        callbacks.peers = peers;
        std::vector<Gaussians<Cpu>> seen;
        seen.push_back(train<Cpu>(scene, options, callbacks, [&](int, const auto& splats_now) {
            copy(splats_now(), seen.emplace_back());
        }));
        return seen;
    };
    const std::vector<Gaussians<Cpu>> one = run(nullptr);
    expect_same_bits(one.back(), train_on(nullptr, scene, options).splats, "unseen");
    for (const int ranks : {2, 3})
        on_ranks(ranks, [&](test::ThreadRank* peers) {
            const std::vector<Gaussians<Cpu>> seen = run(peers);
            ASSERT_EQ(seen.size(), one.size());
            for (std::size_t i = 0; i < one.size(); ++i)
                expect_same_bits(seen[i], one[i], str(ranks, " ranks, step ", i + 1));
        });
}

TEST(RanksTwins, CudaHasTheBitsOfOneProcess) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        const Scene scene = six_views();
        const TrainOptions options = options_of_batch(61, 4);
        const End one = train_on<Cuda>(nullptr, scene, options);
        for (const int ranks : {2, 4})
            on_ranks(ranks, [&](test::ThreadRank* peers) {
                const End end = train_on<Cuda>(peers, scene, options);
                EXPECT_EQ(end.losses, one.losses) << ranks;
                expect_same_bits(end.splats, one.splats, str(ranks, " ranks"));
                if (peers->rank() == 0) expect_same_arrays(*end.state, *one.state);
            });
        const End cpu = train_on<Cpu>(nullptr, scene, options);
        EXPECT_TRUE(test::close(one.losses[0], cpu.losses[0], 1e-4));
    }
}

TEST(RanksMemory, EachHoldsItsPart) {
    const Scene scene = with_far(six_views(), 3000);
    TrainOptions options = options_of_batch(8, 4);
    options.densify.enabled = false;
    for (const int ranks : {2, 4})
        on_ranks(ranks, [&](test::ThreadRank* peers) {
            TrainCallbacks callbacks;
            callbacks.peers = peers;
            std::size_t bytes = 0;
            callbacks.save_due = [](int done) { return done == 4; };
            callbacks.on_save = [&](int, const SharedState& state) {
                for (const StateArray& array : state->arrays) bytes += array.bytes.size();
            };
            train<Cpu>(scene, options, callbacks);
            const double splats = static_cast<double>(scene.points.positions.size());
            EXPECT_LT(static_cast<double>(bytes), 1.1 * 830 * splats / ranks);
        });
}

TEST(Batch, ExchangesOnlyWhatAPhotographSees) {
    Scene scene = six_views();
    TrainOptions options = options_of_batch(8, 2);
    options.loss.tv_normal.weight = options.loss.tv_position.weight = 0;
    options.tv.enabled = options.densify.enabled = false;
    const auto bytes_with = [&](int far) {
        const Scene with = with_far(scene, far);
        std::size_t bytes = 0;
        on_ranks(2, [&](test::ThreadRank* peers) {
            train_on(peers, with, options);
            if (peers->rank() == 0) bytes = peers->dealt;
        });
        return bytes;
    };
    const std::size_t near = bytes_with(0);
    EXPECT_GT(near, 4u * 100 * 64);
    EXPECT_LT(bytes_with(5000), near + near / 10);
}

/// Of a splat that none sees its geometry goes round each step, its harmonics once, in the end.
TEST(Batch, SharesTheHarmonicsOfWhatPhotographsSee) {
    const Scene scene = six_views();
    TrainOptions options = options_of_batch(40, 2);
    options.loss.tv_normal.weight = options.loss.tv_position.weight = 0;
    options.model.sh_every = 1;
    options.tv.enabled = options.densify.enabled = false;
    const auto bytes_with = [&](int far) {
        const Scene with = with_far(scene, far);
        std::size_t bytes = 0;
        on_ranks(2, [&](test::ThreadRank* peers) {
            train<Cpu>(with, options, [&] {
                TrainCallbacks callbacks;
                callbacks.peers = peers;
                return callbacks;
            }());
            if (peers->rank() == 0) bytes = peers->gathered;
        });
        return static_cast<double>(bytes);
    };
    constexpr int kFar = 5000, kSteps = 19, kGeometry = 4 * 11, kHarmonics = 4 * 3 * 16;
    const double each = (bytes_with(kFar) - bytes_with(0)) / kFar;
    EXPECT_NEAR(each, kSteps * kGeometry + kHarmonics, 1);
}

TEST(Batch, NamesWhatCannotBe) {
    const Scene scene = six_views();
    const auto refusal = [&](const TrainOptions& options, int ranks) -> std::string {
        try {
            check_batch(scene, options, ranks);
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::usage);
            return error.what();
        }
        return "";
    };
    EXPECT_EQ(refusal(options_of_batch(10, 6), 4), "");
    EXPECT_NE(refusal(options_of_batch(10, 7), 1).find("comm.batch = 7"), std::string::npos);
    EXPECT_NE(refusal(options_of_batch(10, 2), 4).find("comm.batch=4"), std::string::npos);
    TrainOptions anchored = options_of_batch(10, 2);
    anchored.loss.anchored_depth.weight = 1;
    EXPECT_NE(refusal(anchored, 2).find("loss.anchored_depth"), std::string::npos);
    EXPECT_EQ(refusal(anchored, 1), "");
}

}  // namespace
}  // namespace tvsgs
