// Fixed splats (init.fixed_splats): rendered with the trained ones, unchanged by training.
#include <cstring>

#include "optim/growth/fixed_splats.h"
#include "optim/loop/train_state.h"
#include "support/numeric.h"
#include "support/random_gaussians.h"
#include "training_scene.h"

namespace tvsgs {
namespace {

template <class T>
std::vector<T> part(const Buffer<T, Cpu>& values, int count, int planes, int first, int n) {
    std::vector<T> out;
    for (int p = 0; p < planes; ++p)
        for (int i = 0; i < n; ++i)
            out.push_back(values.span()[static_cast<std::size_t>(p * count + first + i)]);
    return out;
}

template <class T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

bool same_bits(const Gaussians<Cpu>& a, const Gaussians<Cpu>& b) {
    bool same = true;
    for_each_array([&](const SplatArray&, const auto& x,
                       const auto& y) { same = same && same_bits(to_host(x), to_host(y)); },
                   a, b);
    return same;
}

std::shared_ptr<const Gaussians<Cpu>> shared(Gaussians<Cpu> splats) {
    return std::make_shared<const Gaussians<Cpu>>(std::move(splats));
}

TrainOptions quick(int iterations) {
    TrainOptions options = test::everything_on(iterations);
    options.densify.max_gaussians = 250;
    return options;
}

Gaussians<Cpu> trained(const Scene& scene,
                       const TrainOptions& options,
                       SharedState start = {},
                       std::function<void(int, const SharedState&)> on_save = {},
                       int save = -1) {
    TrainCallbacks callbacks;
    callbacks.save_due = [save](int done) { return done == save; };
    callbacks.on_save = std::move(on_save);
    return train<Cpu>(scene, options, callbacks, {}, start);
}

TEST(FixedSplats, AreJoinedPlaneByPlaneAndPartedAgain) {
    for (const int fixed_degree : {0, 1, 3}) {
        Gaussians<Cpu> own = test::random_gaussians(37, 1, 0.05, 2);
        const auto given = shared(test::random_gaussians(11, 2, 0.05, fixed_degree));
        const Gaussians<Cpu>& fixed = *given;
        FixedSplats<Cpu> splats(given, 2);
        for (int round = 0; round < 2; ++round) {  // the second round has other trained splats
            if (round == 1) own = test::random_gaussians(37, 3, 0.05, 2);
            const Gaussians<Cpu>& all = splats.join(own);
            ASSERT_EQ(all.size(), 48);
            ASSERT_EQ(all.sh_degree, 2);
            for_each_array(
                [&](const SplatArray& array, const auto& joined, const auto& trained_ones) {
                    if (array.optional) return;
                    EXPECT_TRUE(
                        same_bits(part(joined, 48, array.planes, 0, 37), to_host(trained_ones)))
                        << array.name;
                },
                all, own);
            EXPECT_TRUE(same_bits(part(all.means, 48, 1, 37, 11), to_host(fixed.means)));
            const int planes = std::min(sh_count(fixed_degree), sh_count(2));
            EXPECT_TRUE(
                same_bits(part(all.sh, 48, planes, 37, 11), part(fixed.sh, 11, planes, 0, 11)));
            if (fixed_degree == 0) {
                EXPECT_EQ(all.sh.span()[48 + 37].x, 0);
            }
        }
        Gaussians<Cpu>& gradients = splats.clear_gradients();
        for (float& g : gradients.opacity_logits.span()) g = 2;
        Gaussians<Cpu> sum;
        resize(sum, 37, 2);
        fill_zero(sum);
        for (float& g : sum.opacity_logits.span()) g = 1;
        splats.add_trained_part(sum);
        for (const float g : to_host(sum.opacity_logits)) EXPECT_EQ(g, 3);
    }
}

template <class Device>
std::pair<Gaussians<Cpu>, Gaussians<Cpu>> joined_and_parted() {
    FixedSplats<Device> splats(shared(test::random_gaussians(300, 2, 0.05, 1)), 2);
    Gaussians<Device> own, sum;
    copy(test::random_gaussians(700, 1, 0.05, 2), own);
    copy(test::random_gaussians(700, 3, 0.05, 2), sum);
    std::pair<Gaussians<Cpu>, Gaussians<Cpu>> out;
    copy(splats.join(own), out.first);
    copy(splats.join(own), splats.clear_gradients());
    splats.add_trained_part(sum);
    copy(sum, out.second);
    return out;
}

TEST(FixedSplatsTwins, CpuAgainstCuda) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        const auto cpu = joined_and_parted<Cpu>(), cuda = joined_and_parted<Cuda>();
        EXPECT_TRUE(same_bits(cpu.first, cuda.first));
        EXPECT_TRUE(same_bits(cpu.second, cuda.second));
    }
}

TEST(FixedSplats, WithoutAnyTheTrainedOnesThemselvesAreDrawn) {
    const Gaussians<Cpu> own = test::random_gaussians(5, 1, 0.05, 1);
    FixedSplats<Cpu> none({}, 1);
    EXPECT_TRUE(none.none());
    EXPECT_EQ(&none.join(own), &own);
}

// The photographs are renders of trained and fixed splats together. The trained half gets the same
// gradients as if all splats were trained.
TEST(FixedSplats, GradientsAreThoseOfTheWhole) {
    const Scene scene = test::rendered_scene();
    TrainOptions options;
    options.loss = {};
    options.init.min_points = 0;
    options.model.sh_degree = 1;
    Gaussians<Cpu> all = init_gaussians(scene, options.init, options.model.sh_degree);
    const int n = all.size(), half = n / 2;
    const auto keep = [&](int first, int count) {
        Gaussians<Cpu> some;
        resize(some, count, all.sh_degree);
        for_each_array(
            [&]<class T>(const SplatArray& array, const Buffer<T, Cpu>& from, Buffer<T, Cpu>& to) {
                if (array.optional) return;
                const std::vector<T> kept = part(from, n, array.planes, first, count);
                std::copy(kept.begin(), kept.end(), to.data());
            },
            std::as_const(all), some);
        return some;
    };
    const Gaussians<Cpu> own = keep(0, half);
    Scene divided = scene;
    divided.fixed_splats = shared(keep(half, n - half));

    const auto gradients = [&](const Scene& of, const Gaussians<Cpu>& splats) {
        Iteration<Cpu> iteration(of, options, true);
        const auto terms = make_terms<Cpu>(of, options);
        TensorField<Cpu> field;
        const auto next = [] { return 0; };
        iteration.propagate(1, iteration.fetch(1, 0, terms, next), splats, terms, field, false, {},
                            [](auto&) {});
        iteration.finish_statistics();
        return to_host(iteration.backbone().statistics().dL_dmeans2d);
    };
    const auto whole = gradients(scene, all), divided_ones = gradients(divided, own);
    ASSERT_EQ(divided_ones.size(), static_cast<std::size_t>(n));
    double largest = 0;
    for (int i = 0; i < half; ++i) {
        const auto at = static_cast<std::size_t>(i);
        EXPECT_EQ(whole[at].x, divided_ones[at].x) << i;
        EXPECT_EQ(whole[at].y, divided_ones[at].y) << i;
        largest = std::max(largest, std::abs(static_cast<double>(whole[at].x)));
    }
    EXPECT_GT(largest, 0);
}

// With growth, trims, votes, neighbour views and checkpoints: the result excludes the fixed splats
// but depends on them, and a resumed run gives the same bits.
TEST(FixedSplats, TrainingGrowsAndResumesBesideThem) {
    Scene scene = test::rendered_scene();
    const TrainOptions options = quick(60);
    const Gaussians<Cpu> alone = trained(scene, options);
    Gaussians<Cpu> fixed = init_gaussians(scene, options.init, options.model.sh_degree);
    for (Vec3f& mean : fixed.means.span()) mean.z += 0.3f;
    const std::vector<Vec3f> before = to_host(fixed.means);
    scene.fixed_splats = shared(std::move(fixed));

    SharedState saved;
    const Gaussians<Cpu> beside = trained(
        scene, options, {}, [&](int, const SharedState& s) { saved = s; }, 33);
    EXPECT_FALSE(same_bits(alone, beside));
    EXPECT_LE(beside.size(), options.densify.max_gaussians);
    EXPECT_TRUE(same_bits(to_host(scene.fixed_splats->means), before));
    ASSERT_TRUE(saved);
    EXPECT_TRUE(same_bits(beside, trained(scene, options, saved)));
}

}  // namespace
}  // namespace tvsgs
