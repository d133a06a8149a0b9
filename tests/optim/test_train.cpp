// The whole training loop on a scene of a few pixels.

#include <cstring>

#include "core/device/threads.h"
#include "training_scene.h"

namespace tvsgs {
namespace {

using test::everything_on;
using test::rendered_scene;

struct Training {
    Gaussians<Cpu> gaussians;
    std::vector<TrainReport> reports;
};

template <class Device>
Training run(const Scene& scene, const TrainOptions& options, int stop_after = -1) {
    Training result;
    TrainCallbacks callbacks;
    callbacks.report_due = [](int) { return true; };
    callbacks.on_report = [&](const TrainReport& r) { result.reports.push_back(r); };
    if (stop_after >= 0)
        callbacks.stop_requested = [&] {
            return static_cast<int>(result.reports.size()) == stop_after;
        };
    const Gaussians<Device> gaussians = train<Device>(scene, options, callbacks);
    copy(gaussians, result.gaussians);
    return result;
}

template <class T>
bool same_bits(const Buffer<T, Cpu>& a, const Buffer<T, Cpu>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

bool same_bits(const Gaussians<Cpu>& a, const Gaussians<Cpu>& b) {
    return a.sh_degree == b.sh_degree && same_bits(a.means, b.means) &&
           same_bits(a.log_scales, b.log_scales) && same_bits(a.quats, b.quats) &&
           same_bits(a.opacity_logits, b.opacity_logits) && same_bits(a.sh, b.sh);
}

double term(const TrainReport& report, const std::string& name) {
    for (const auto& [key, value] : report.terms)
        if (key == name) return value;
    ADD_FAILURE() << "no term " << name;
    return 0;
}

/// Mean photometric loss over one round of the three views.
double photometric(const std::vector<TrainReport>& reports, std::size_t first) {
    double sum = 0;
    for (std::size_t i = first; i < first + 3; ++i) sum += term(reports[i], "photometric") / 3;
    return sum;
}

TEST(Train, SixtyIterationsLowerTheLoss) {
    TrainOptions options;
    options.iterations = 60;
    options.tv.enabled = false;
    const Training r = run<Cpu>(rendered_scene(), options);
    ASSERT_EQ(r.reports.size(), 60u);
    EXPECT_EQ(r.reports.back().step, 60);
    // Twenty steps per view, from grey splats at a tenth of full opacity; measured ratio: 0.60.
    EXPECT_LT(photometric(r.reports, 57), 0.7 * photometric(r.reports, 0));
    for (const TrainReport& report : r.reports) EXPECT_EQ(report.gaussians, 150);
}

TEST(Train, EveryTermActsAndGrowthHappens) {
    const Training r = run<Cpu>(rendered_scene(), everything_on(42));
    EXPECT_GT(term(r.reports[0], "flatten"), 0);
    EXPECT_GT(term(r.reports[0], "tv_normal"), 0);
    EXPECT_GT(term(r.reports[0], "tv_position"), 0);
    EXPECT_EQ(term(r.reports[3], "normal"), 0);
    EXPECT_GT(term(r.reports[4], "normal"), 0);
    EXPECT_EQ(term(r.reports[5], "multi_view_geometry"), 0);
    EXPECT_GT(term(r.reports[6], "multi_view_geometry"), 0);
    EXPECT_EQ(term(r.reports[7], "multi_view_ncc"), 0);
    EXPECT_GT(term(r.reports[8], "multi_view_ncc"), 0);
    EXPECT_NE(r.reports.back().gaussians, r.reports.front().gaussians);
    EXPECT_EQ(r.gaussians.size(), r.reports.back().gaussians);
    double sum = 0;
    for (const auto& [name, value] : r.reports.back().terms) sum += value;
    EXPECT_EQ(r.reports.back().loss, sum);
    for (std::size_t i = 0; i < r.gaussians.means.size(); ++i)
        ASSERT_TRUE(is_finite(r.gaussians.means[i]) && is_finite(r.gaussians.log_scales[i]));
}

TEST(Train, TheSameBitsWithAnyNumberOfThreads) {
    const Scene scene = rendered_scene();
    TrainOptions options = everything_on(42);
    const int threads = thread_count();
    set_thread_count(1);
    const Training a = run<Cpu>(scene, options);
    set_thread_count(3);
    const Training b = run<Cpu>(scene, options);
    set_thread_count(threads);
    EXPECT_TRUE(same_bits(a.gaussians, b.gaussians));
    EXPECT_EQ(a.reports.back().loss, b.reports.back().loss);
    options.seed = 1;
    EXPECT_FALSE(same_bits(a.gaussians, run<Cpu>(scene, options).gaussians));
}

TEST(Train, NoIterationsGiveTheInitialGaussians) {
    const Scene scene = rendered_scene();
    TrainOptions options = everything_on(0);
    const Training r = run<Cpu>(scene, options);
    EXPECT_TRUE(r.reports.empty());
    Gaussians<Cpu> first = init_gaussians(scene, options.init, options.model.sh_degree);
    EXPECT_FALSE(same_bits(r.gaussians, first)) << "a case that needs no sorting";
    sort_by_place(first);
    EXPECT_TRUE(same_bits(r.gaussians, first));
}

TEST(Train, TheLastIterationFadesNothing) {
    const Scene scene = rendered_scene();
    TrainOptions options;
    options.iterations = 12;
    options.tv.enabled = false;
    options.densify.enabled = true;
    options.densify.until = 1000;
    const auto with_resets_every = [&](int iterations) {
        options.densify.opacity_reset_every = iterations;
        return run<Cpu>(scene, options).gaussians;
    };
    const Gaussians<Cpu> none = with_resets_every(1000);
    EXPECT_TRUE(same_bits(with_resets_every(12), none));
    EXPECT_FALSE(same_bits(with_resets_every(6), none));
}

TEST(Train, StopsWhenAsked) {
    const Scene scene = rendered_scene();
    TrainOptions options;
    options.tv.enabled = false;
    options.iterations = 1000000;
    const Training stopped = run<Cpu>(scene, options, 5);
    EXPECT_EQ(stopped.reports.size(), 5u);
    // The last iteration of a run makes no step, so the sixth of six changes nothing.
    options.iterations = 6;
    EXPECT_TRUE(same_bits(stopped.gaussians, run<Cpu>(scene, options).gaussians));
}

TEST(Train, LengthUnitDividesByAThirdOfTheDepth) {
    const Scene scene = rendered_scene();
    TrainOptions options = everything_on(1);
    const Training world = run<Cpu>(scene, options);
    options.loss.length_unit = LengthUnit::depth;
    const Training depth = run<Cpu>(scene, options);
    const double unit = median_depth(scene) / 3;
    EXPECT_GT(unit, 1.1);
    // Weights are float.
    for (const char* name : {"flatten", "tv_position"})
        EXPECT_TRUE(test::close(term(world.reports[0], name) / unit, term(depth.reports[0], name),
                                1e-6, 0));
    EXPECT_EQ(term(world.reports[0], "tv_normal"), term(depth.reports[0], "tv_normal"));
}

TEST(TrainTwins, CpuAgainstCuda) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        const Scene scene = rendered_scene();
        TrainOptions options = everything_on(20);
        options.densify.enabled = false;
        const Training cpu = run<Cpu>(scene, options), cuda = run<Cuda>(scene, options);
        EXPECT_TRUE(test::close(cpu.reports[0].loss, cuda.reports[0].loss, 1e-4));
        // Where a gradient is a rounding error, Adam still takes a full step: parameters diverge,
        // losses hardly.
        EXPECT_TRUE(test::close(photometric(cpu.reports, 17), photometric(cuda.reports, 17), 0.02));
    }
}

TEST(TrainTwins, CudaGivesTheSameBitsTwice) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        const Scene scene = rendered_scene();
        const Training a = run<Cuda>(scene, everything_on(42)),
                       b = run<Cuda>(scene, everything_on(42));
        EXPECT_TRUE(same_bits(a.gaussians, b.gaussians));
        EXPECT_EQ(a.reports.back().loss, b.reports.back().loss);
        EXPECT_NE(a.reports.back().gaussians, a.reports.front().gaussians);
    }
}

}  // namespace
}  // namespace tvsgs
