// Tests voting events in other orders, frames, sizes and options, for each device.
#include <spdlog/sinks/ostream_sink.h>

#include <cstring>
#include <numeric>
#include <sstream>

#include "core/log.h"
#include "tv/tv_support.h"
#include "tv/voting.h"

namespace tvsgs::test {
namespace {

template <class Device>
class VotingEvents : public ::testing::Test {};
TYPED_TEST_SUITE(VotingEvents, Devices);

TYPED_TEST(VotingEvents, AnchorsAreTheCentresAndChangeNothingElse) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    const Cloud cloud = sphere(400, 22, 0.03f);
    TvOptions options = options_with(20);
    const FieldOnHost votes = run_events<TypeParam>(cloud, options, 2);
    options.targets = Targets::anchor;
    const FieldOnHost anchor = run_events<TypeParam>(cloud, options, 2);
    int moved = 0;
    for (int i = 0; i < cloud.size(); ++i) {
        const std::size_t s = std::size_t(i);
        EXPECT_EQ(norm(anchor.targets[s] - cloud.means[s]), 0);
        moved += norm(votes.targets[s] - cloud.means[s]) > 0;
    }
    EXPECT_GT(moved, cloud.size() / 10);
    EXPECT_EQ(votes.flags, anchor.flags);  // the same splats take part
    EXPECT_EQ(std::memcmp(votes.normals.data(), anchor.normals.data(),
                          votes.normals.size() * sizeof(Vec3f)),
              0);
}

TYPED_TEST(VotingEvents, RigidMotionAndScaling) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    Cloud cloud = sphere(400, 6);
    const FieldOnHost f = run_events<TypeParam>(cloud, options_with(20), 2);
    Random random(7);
    const Quatf q = random.quat();
    const Mat3f R = rotation(q);
    Cloud moved;
    for (int i = 0; i < cloud.size(); ++i) {
        const Quatf p = cloud.quats[i];
        const Quatf product{q.w * p.w - q.x * p.x - q.y * p.y - q.z * p.z,
                            q.w * p.x + q.x * p.w + q.y * p.z - q.z * p.y,
                            q.w * p.y - q.x * p.z + q.y * p.w + q.z * p.x,
                            q.w * p.z + q.x * p.y - q.y * p.x + q.z * p.w};
        moved.add(R * cloud.means[i] + Vec3f{1, -2, 0.5f}, cloud.scales[i], product);
    }
    const FieldOnHost g = run_events<TypeParam>(moved, options_with(20), 2);
    std::vector<double> tensor_errors, normal_errors;
    for (int i = 0; i < cloud.size(); ++i) {
        if (sorted_row(f.details.receivers, 20, i) != sorted_row(g.details.receivers, 20, i))
            continue;
        Mat3f T{{{f.tensors[i].xx, f.tensors[i].xy, f.tensors[i].xz},
                 {f.tensors[i].xy, f.tensors[i].yy, f.tensors[i].yz},
                 {f.tensors[i].xz, f.tensors[i].yz, f.tensors[i].zz}}};
        T = R * T * transpose(R);
        const Sym3f turned{T[0][0], T[0][1], T[0][2], T[1][1], T[1][2], T[2][2]};
        tensor_errors.push_back(frobenius(difference(turned, g.tensors[i])) / frobenius(turned));
        normal_errors.push_back(angle_deg(R * f.normals[i], g.normals[i]));
    }
    EXPECT_GT(tensor_errors.size(), 0.98 * cloud.size());
    EXPECT_LT(median_of(tensor_errors), 1e-5);
    // Moved inputs are rounded again, and flat splats magnify the error.
    EXPECT_LT(*std::max_element(tensor_errors.begin(), tensor_errors.end()), 1e-3);
    EXPECT_LT(*std::max_element(normal_errors.begin(), normal_errors.end()), 0.1);

    for (const float scale : {1e-3f, 1e3f}) {
        Cloud scaled = cloud;
        for (Vec3f& p : scaled.means) p = scale * p;
        for (Vec3f& s : scaled.scales) s = scale * s;
        const FieldOnHost h = run_events<TypeParam>(scaled, options_with(20), 2);
        normal_errors.clear();
        for (int i = 0; i < cloud.size(); ++i)
            normal_errors.push_back(angle_deg(f.normals[i], h.normals[i]));
        EXPECT_LT(median_of(normal_errors), 1e-3);
        EXPECT_LT(*std::max_element(normal_errors.begin(), normal_errors.end()), 0.1);
    }
}

TYPED_TEST(VotingEvents, PermutationAndRepetition) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    const Cloud cloud = sphere(600, 8);
    const FieldOnHost f = run_events<TypeParam>(cloud, options_with(20), 3);
    EXPECT_TRUE(same_bits(f, run_events<TypeParam>(cloud, options_with(20), 3)));

    Cloud reversed = cloud;
    std::reverse(reversed.means.begin(), reversed.means.end());
    std::reverse(reversed.scales.begin(), reversed.scales.end());
    std::reverse(reversed.quats.begin(), reversed.quats.end());
    const FieldOnHost g = run_events<TypeParam>(reversed, options_with(20), 3);
    for (int i = 0; i < cloud.size(); ++i) {
        const std::size_t j = std::size_t(cloud.size()) - 1 - i;
        // Sums in another order.
        EXPECT_LT(frobenius(difference(f.tensors[i], g.tensors[j])),
                  1e-4 * frobenius(f.tensors[i]));
        EXPECT_EQ(f.flags[i], g.flags[j]);
    }
}

TYPED_TEST(VotingEvents, FifteenHundredEventsStayAlive) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    const Cloud cloud = sphere(80, 9);
    const auto g = to_gaussians<TypeParam>(cloud);
    TensorVoter<TypeParam> voter(options_with(10));
    TensorField<TypeParam> field;
    const auto tenth_percentile = [&] {
        std::vector<double> saliency;
        for (const Vec3f l : to_host(field.eigenvalues)) saliency.push_back(relative_gap(l));
        std::nth_element(saliency.begin(), saliency.begin() + 8, saliency.end());
        return saliency[8];
    };
    double at_event_10 = 0;
    for (int event = 1; event <= 1500; ++event) {
        voter.vote(1 + 10 * (event - 1), g, field);
        if (event == 10) at_event_10 = tenth_percentile();
    }
    EXPECT_GT(at_event_10, 0);
    EXPECT_GE(tenth_percentile(), 0.5 * at_event_10);
    for (const std::uint8_t flags : to_host(field.flags)) EXPECT_NE(flags & kHasTensor, 0);
}

TYPED_TEST(VotingEvents, AllSizesAndOptions) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    for (const int count : {0, 1, 2, 3, 31, 150, 257}) {
        for (int variant = 0; variant < (count < 31 || count > 150 ? 1 : 6); ++variant) {
            TvOptions options = options_with(60);  // N < 2k + 1, except the last
            options.whiten_noise_mode = variant == 1 ? NoiseMode::per_splat : NoiseMode::global;
            options.strength = variant == 2 ? VoteStrength::literal : VoteStrength::relative;
            options.vote_map = variant == 3 ? VoteMap::unit : VoteMap::covariant;
            options.flatness_limit_position = variant == 4 ? 1.0f : 0.0f;
            options.max_vote_angle_deg = variant == 5 ? 45.0f : 90.0f;
            const FieldOnHost f = run_events<TypeParam>(sphere(count, 10), options, 3);
            ASSERT_EQ(f.flags.size(), std::size_t(count));
            ASSERT_EQ(f.targets.size(), std::size_t(count));
            for (int i = 0; i < count; ++i) {
                EXPECT_TRUE(is_finite(f.normals[i]) && is_finite(f.targets[i]) &&
                            is_finite(f.eigenvalues[i]));
                if (count < 2) {
                    EXPECT_EQ(f.flags[i], 0);
                }
                if (count > 60) {
                    EXPECT_EQ(f.flags[i] & kHasTensor, kHasTensor);
                }
                EXPECT_EQ(f.flags[i] & ~(kHasTensor | kNormalValid | kPositionValid), 0);
                if ((f.flags[i] & kPositionValid) != 0) {
                    EXPECT_NE(f.flags[i] & kNormalValid, 0);
                }
            }
        }
    }
}

TYPED_TEST(VotingEvents, WithoutTargetsNoVirtualReceivers) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    const auto g = to_gaussians<TypeParam>(sphere(300, 12));
    TensorVoter<TypeParam> with(options_with(40)), without(options_with(40));
    TensorField<TypeParam> a, b;
    without.set_profiling(true);
    for (const int step : {1, 11}) with.vote(step, g, a), without.vote(step, g, b, false);
    for (const StageTime& stage : without.profile().stages) {
        const std::string_view name = stage.name;
        EXPECT_TRUE(name != "virtual" && name != "masks") << name;
    }
    const auto normals = to_host(a.normals), same_normals = to_host(b.normals);
    const auto targets = to_host(b.targets), means = to_host(g.means);
    const auto flags = to_host(a.flags), flags_without = to_host(b.flags);
    int valid = 0;
    for (std::size_t i = 0; i < means.size(); ++i) {
        EXPECT_EQ(norm(normals[i] - same_normals[i]), 0);
        EXPECT_EQ(norm(targets[i] - means[i]), 0);
        EXPECT_EQ(flags_without[i], flags[i] & (kHasTensor | kNormalValid));
        valid += (flags[i] & kPositionValid) != 0;
    }
    EXPECT_GT(valid, 0) << "nothing would have been left out";
}

TYPED_TEST(VotingEvents, SplatsThatAreNotFiniteAreLeftOut) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    const Cloud clean = sphere(300, 12);
    Cloud spoilt = clean;
    spoilt.add({std::nanf(""), 0, 0}, {1, 1, 1}, {1, 0, 0, 0});
    spoilt.add({0, 0, 0}, {HUGE_VALF, 1, 1}, {1, 0, 0, 0});
    spoilt.add({0, 0, 0}, {1, 1, 1}, {0, 0, 0, 0});
    const FieldOnHost f = run_events<TypeParam>(clean, options_with(20), 2);
    const FieldOnHost g = run_events<TypeParam>(spoilt, options_with(20), 2);
    for (int i = 0; i < clean.size(); ++i)
        EXPECT_LT(frobenius(difference(f.tensors[i], g.tensors[i])),
                  1e-5 * frobenius(f.tensors[i]));
    for (int i = clean.size(); i < spoilt.size(); ++i) EXPECT_EQ(g.flags[i], 0);
}

TYPED_TEST(VotingEvents, NewSplatsInheritAndAreDueAtOnce) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    TvOptions options = options_with(20);
    options.start = 5;
    TensorVoter<TypeParam> voter(options);
    EXPECT_FALSE(voter.due(4));
    EXPECT_TRUE(voter.due(5));
    EXPECT_FALSE(voter.due(6));
    EXPECT_TRUE(voter.due(15));

    Cloud cloud = sphere(300, 13);
    TensorField<TypeParam> field;
    voter.vote(5, to_gaussians<TypeParam>(cloud), field);
    const auto normals = to_host(field.normals);
    const auto flags = to_host(field.flags);

    // Splat 0 is dropped, splat 7 cloned, and one has no parent.
    std::vector<int> parents(299);
    std::iota(parents.begin(), parents.end(), 1);
    parents.push_back(7);
    parents.push_back(-1);
    const auto parents_there = to_device<TypeParam>(parents);
    voter.structure_changed(parents_there.span(), field);
    EXPECT_TRUE(voter.due(6));
    const auto new_normals = to_host(field.normals);
    const auto new_flags = to_host(field.flags);
    ASSERT_EQ(new_flags.size(), parents.size());
    for (std::size_t i = 0; i < parents.size(); ++i) {
        if (parents[i] < 0) {
            EXPECT_EQ(new_flags[i], 0);
            continue;
        }
        EXPECT_EQ(new_flags[i], flags[parents[i]] & (kHasTensor | kNormalValid));
        EXPECT_EQ(norm(new_normals[i] - normals[parents[i]]), 0);
    }
    Cloud next;
    for (const int parent : parents)
        next.add(cloud.means[parent < 0 ? 3 : parent], cloud.scales[parent < 0 ? 3 : parent],
                 cloud.quats[parent < 0 ? 3 : parent]);
    voter.vote(6, to_gaussians<TypeParam>(next), field);
    EXPECT_FALSE(voter.due(7));
    EXPECT_EQ(voter.details().receivers.size(), parents.size() * 20);
    EXPECT_NE(to_host(field.flags).back() & kHasTensor, 0);  // reached by the plate round

    // Before the first event there is nothing to inherit.
    TensorVoter<TypeParam> fresh(options);
    TensorField<TypeParam> empty;
    fresh.structure_changed(parents_there.span(), empty);
    EXPECT_TRUE(empty.flags.empty());
    EXPECT_FALSE(fresh.due(4));
}

TYPED_TEST(VotingEvents, WarnsOnce) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    std::ostringstream text;
    const auto previous = spdlog::default_logger();
    spdlog::set_default_logger(std::make_shared<spdlog::logger>(
        "test", std::make_shared<spdlog::sinks::ostream_sink_mt>(text)));
    Cloud cloud = sphere(100, 14);
    cloud.scales[3] = {2000, 2000, 2000};  // spacing: 0.35
    TvOptions options = options_with(10);
    options.refresh_every = 1;
    run_events<TypeParam>(cloud, options, 3);
    run_events<TypeParam>(sphere(1, 15), options, 3);
    spdlog::set_default_logger(previous);
    const std::string log = text.str();
    const std::size_t giant = log.find("per_splat"), few = log.find("tensor voting is off");
    EXPECT_NE(giant, std::string::npos);
    EXPECT_EQ(log.find("per_splat", giant + 1), std::string::npos);
    EXPECT_NE(few, std::string::npos);
    EXPECT_EQ(log.find("tensor voting is off", few + 1), std::string::npos);
}

}  // namespace
}  // namespace tvsgs::test
