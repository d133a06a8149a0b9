// Tests voting events on clouds with known results, for each device.
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
class Voting : public ::testing::Test {};
TYPED_TEST_SUITE(Voting, Devices);

TvOptions options_with(int k) {
    TvOptions options;
    options.k = k;
    return options;
}

double median_of(std::vector<double> values) {
    std::nth_element(values.begin(), values.begin() + std::ptrdiff_t(values.size() / 2),
                     values.end());
    return values[values.size() / 2];
}

double median_normal_error(const FieldOnHost& f, const std::vector<Vec3f>& normals) {
    std::vector<double> errors;
    for (std::size_t i = 0; i < normals.size(); ++i)
        errors.push_back(angle_deg(f.normals[i], normals[i]));
    return median_of(errors);
}

Vec3f tilted(Random& random, Vec3f normal, float by) {
    return normalize(normal + by * random.normal3());
}

bool same_bits(const FieldOnHost& a, const FieldOnHost& b) {
    const auto equal = [](const auto& x, const auto& y) {
        return x.size() == y.size() &&
               std::memcmp(x.data(), y.data(), x.size() * sizeof(x[0])) == 0;
    };
    return equal(a.tensors, b.tensors) && equal(a.eigenvalues, b.eigenvalues) &&
           equal(a.normals, b.normals) && equal(a.targets, b.targets) && equal(a.flags, b.flags);
}

Cloud sphere(int count, unsigned seed, float noise = 0.01f) {
    Random random(seed);
    Cloud cloud;
    const float spacing = std::sqrt(12.57f / float(count));
    for (int i = 0; i < count; ++i) {
        const Vec3f n = normalize(random.normal3());
        cloud.add((1 + noise * random.normal()) * n, random.flat_scales(0.5f * spacing),
                  quat_from_z(tilted(random, n, 0.1f)));
    }
    return cloud;
}

TYPED_TEST(Voting, NoisyPlaneWithOutliers) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    // 10% outliers in a box twice as thick as the plane is wide, flat splats tilted by 0.1 rad,
    // sigma = 2% of the spacing x sqrt(k).
    constexpr int kCount = 2500, k = 100;
    Random random(1);
    const float spacing = 2 / std::sqrt(float(kCount)),
                sigma = 0.02f * spacing * std::sqrt(float(k));
    Cloud cloud;
    std::vector<int> on_plane;
    for (int i = 0; i < kCount; ++i) {
        const bool outlier = i % 10 == 0;
        if (!outlier) on_plane.push_back(i);
        const float z = outlier ? random.uniform(-2, 2) : sigma * random.normal();
        const Quatf quat = outlier ? random.quat() : quat_from_z(tilted(random, {0, 0, 1}, 0.1f));
        cloud.add({random.uniform(-1, 1), random.uniform(-1, 1), z},
                  {spacing, spacing, 0.1f * spacing}, quat);
    }
    const FieldOnHost f = run_events<TypeParam>(cloud, options_with(k), 2);
    std::vector<double> errors;
    double before = 0, after = 0;
    for (const int i : on_plane) {
        errors.push_back(angle_deg(f.normals[i], {0, 0, 1}));
        before += double(cloud.means[i].z) * cloud.means[i].z;
        after += double(f.targets[i].z) * f.targets[i].z;
    }
    EXPECT_LT(median_of(errors), 2);
    EXPECT_LT(after, before);
}

/// A noisy sphere with 10 % outliers; splats of `spacings` mean distances.
Cloud sphere_of(float spacings, std::vector<Vec3f>& normals) {
    Random random(21);
    Cloud cloud;
    constexpr int kCount = 1200;
    const float spacing = std::sqrt(12.57f / float(kCount));
    for (int i = 0; i < kCount; ++i) {
        const bool outlier = i % 10 == 0;
        const Vec3f n = normalize(random.normal3());
        const Vec3f place =
            outlier ? Vec3f{random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1)}
                    : (1 + 0.2f * spacing * random.normal()) * n;
        cloud.add(place, random.flat_scales(spacings * spacing),
                  quat_from_z(tilted(random, n, 0.1f)));
        normals.push_back(outlier ? Vec3f{} : n);
    }
    return cloud;
}

TYPED_TEST(Voting, ScaleFreeVotesDoNotGoByTheSizeOfSplats) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    const auto spread = [](Curvature curvature) {
        double least = 180, most = 0;
        for (const float spacings : {0.1f, 0.3f, 1.0f, 3.0f}) {
            std::vector<Vec3f> normals;
            const Cloud cloud = sphere_of(spacings, normals);
            TvOptions options = options_with(100);  // the default
            options.vote_map = VoteMap::unit;
            options.flatness_limit = options.flatness_limit_position = 1;
            options.curvature = curvature;
            const FieldOnHost f = run_events<TypeParam>(cloud, options, 3);
            std::vector<double> errors;
            for (int i = 0; i < cloud.size(); ++i)
                if (norm(normals[std::size_t(i)]) > 0)
                    errors.push_back(angle_deg(f.normals[std::size_t(i)], normals[std::size_t(i)]));
            const double error = median_of(errors);
            std::printf("  %s, splats of %.1f spacings: %.2f degrees\n",
                        curvature == Curvature::literal ? "literal" : "scale-free",
                        double(spacings), error);
            least = std::min(least, error), most = std::max(most, error);
        }
        return most - least;
    };
    EXPECT_LT(spread(Curvature::scale_free), 1);
    EXPECT_GT(spread(Curvature::literal), 2);  // shows that the test can fail
}

TYPED_TEST(Voting, AnchorsAreTheCentresAndChangeNothingElse) {
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

TYPED_TEST(Voting, NobodyFallsSilentAmongEightDecadesOfScale) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    // A plane of small splats with a few giants, whose covariant votes are 10^16 times longer. At a
    // distance of 7 standard deviations the giants still outweigh the other splats.
    Random random(23);
    Cloud cloud;
    for (int i = 0; i < 600; ++i) {
        const float size = std::pow(10.0f, random.uniform(-6, 2));
        cloud.add({random.uniform(-1, 1), random.uniform(-1, 1), 0.01f * random.normal()},
                  {size, size, 0.1f * size}, quat_from_z(tilted(random, {0, 0, 1}, 0.1f)));
    }
    TvOptions options = options_with(40);
    options.whiten_noise_mode = NoiseMode::per_splat;
    const FieldOnHost f = run_events<TypeParam>(cloud, options, 2);
    int heard = 0;
    for (const std::uint8_t flags : f.flags) heard += (flags & kHasTensor) != 0;
    EXPECT_EQ(heard, cloud.size());
}

TYPED_TEST(Voting, SphereAndCylinder) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    const Cloud ball = sphere(1200, 2);
    TvOptions options = options_with(40);
    options.vote_map =
        VoteMap::unit;  // covariant votes of in-plane anisotropic splats look like sticks
    const FieldOnHost f = run_events<TypeParam>(ball, options, 3);
    EXPECT_LT(median_normal_error(f, ball.means), 5);  // a prototype in double had 3 degrees
    int plates = 0;
    for (const Vec3f l : f.eigenvalues) plates += l.y - l.z > l.x - l.y;
    EXPECT_GT(plates, 0.6 * ball.size());  // plates rather than sticks

    Random random(3);
    Cloud cylinder;
    std::vector<Vec3f> normals;
    for (int i = 0; i < 1200; ++i) {
        const float angle = random.uniform(0, 6.2832f);
        const Vec3f n{std::cos(angle), std::sin(angle), 0};
        cylinder.add(n + Vec3f{0, 0, random.uniform(-2, 2)}, {0.08f, 0.08f, 0.02f},
                     quat_from_z(tilted(random, n, 0.1f)));
        normals.push_back(n);
    }
    EXPECT_LT(median_normal_error(run_events<TypeParam>(cylinder, options_with(40), 3), normals),
              5);
}

TYPED_TEST(Voting, IsolatedCurveIsAStick) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    Random random(4);
    Cloud curve;
    for (int i = 0; i < 300; ++i) {
        const float angle = float(i) / 300 * 6.2832f;
        curve.add({std::cos(angle) + 1e-3f * random.normal(),
                   std::sin(angle) + 1e-3f * random.normal(), 1e-3f * random.normal()},
                  {0.02f, 0.02f, 0.02f}, {1, 0, 0, 0});
    }
    const FieldOnHost f = run_events<TypeParam>(curve, options_with(16), 1);
    int sticks = 0;
    for (const Vec3f l : f.eigenvalues) sticks += l.x - l.y > 5 * (l.y - l.z);
    EXPECT_GT(sticks, 0.9 * curve.size());
}

TYPED_TEST(Voting, CrossingPlanesVaryMostAtTheCrossing) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    Random random(5);
    Cloud cloud;
    for (int i = 0; i < 1600; ++i) {
        const float a = random.uniform(-1, 1), b = random.uniform(-1, 1),
                    off = 0.003f * random.normal();
        const Vec3f n = i % 2 == 0 ? Vec3f{0, 0, 1} : Vec3f{1, 0, 0};
        cloud.add(i % 2 == 0 ? Vec3f{a, b, off} : Vec3f{off, b, a}, {0.04f, 0.04f, 0.01f},
                  quat_from_z(tilted(random, n, 0.05f)));
    }
    const FieldOnHost f = run_events<TypeParam>(cloud, options_with(20), 1);
    double near = 0, far = 0, near_count = 0, far_count = 0;
    int left_out = 0, left_out_near = 0;
    for (int i = 0; i < cloud.size(); ++i) {
        const float distance = std::max(std::abs(cloud.means[i].x), std::abs(cloud.means[i].z));
        const bool close = distance < 0.15f;
        if (close) near += double(f.details.variability[i]), ++near_count;
        if (distance > 0.4f) far += double(f.details.variability[i]), ++far_count;
        left_out += f.details.left_out[i];
        left_out_near += f.details.left_out[i] && close;
        if (f.details.left_out[i]) {
            EXPECT_EQ(f.flags[i] & kPositionValid, 0);
        }
    }
    EXPECT_GT(near / near_count, 2 * far / far_count);
    EXPECT_GT(left_out, 0);
    EXPECT_EQ(left_out_near, left_out);  // the mask falls on the crossing
}

TYPED_TEST(Voting, RigidMotionAndScaling) {
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

TYPED_TEST(Voting, PermutationAndRepetition) {
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

TYPED_TEST(Voting, FifteenHundredEventsStayAlive) {
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

TYPED_TEST(Voting, AllSizesAndOptions) {
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

TYPED_TEST(Voting, WithoutTargetsNoVirtualReceivers) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    const auto g = to_gaussians<TypeParam>(sphere(300, 12));
    TensorVoter<TypeParam> with(options_with(40)), without(options_with(40));
    TensorField<TypeParam> a, b;
    without.set_profiling(true);
    for (const int step : {1, 11}) with.vote(step, g, a), without.vote(step, g, b, false);
    for (const VotingStage& stage : without.profile().stages)
        EXPECT_TRUE(stage.name != "virtual" && stage.name != "masks") << stage.name;
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

TYPED_TEST(Voting, BothNewKeysHelpOnFlatSplats) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    // Unit votes and a flatness limit of 1 move the targets closer to the surface.
    const Cloud cloud = sphere(1200, 11, 0.01f);
    const auto rms = [&](const TvOptions& options) {
        double sum = 0;
        for (const Vec3f p : run_events<TypeParam>(cloud, options, 3).targets)
            sum += std::pow(double(norm(p)) - 1, 2);
        return std::sqrt(sum / cloud.size());
    };
    TvOptions unit = options_with(100);
    unit.vote_map = VoteMap::unit;
    TvOptions both = unit;
    both.flatness_limit_position = 1;  // of the round that makes targets
    const double paper_rms = rms(options_with(100)), unit_rms = rms(unit), both_rms = rms(both);
    EXPECT_LT(unit_rms, paper_rms);
    EXPECT_LT(both_rms, unit_rms);
}

TYPED_TEST(Voting, SplatsThatAreNotFiniteAreLeftOut) {
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

TYPED_TEST(Voting, NewSplatsInheritAndAreDueAtOnce) {
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

TYPED_TEST(Voting, FixedVotersHoldTheSurface) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    // Measured points on a plane.
    Random random(16);
    FixedVoters fixed;
    for (int i = 0; i < 2000; ++i) {
        fixed.means.push_back({random.uniform(-1, 1), random.uniform(-1, 1), 0});
        fixed.normals.push_back({0, 0, 1});
        fixed.scales.push_back(0.05f);
        fixed.weights.push_back(1);
    }
    const auto run = [&](const Cloud& cloud, const FixedVoters& voters) {
        const auto g = to_gaussians<TypeParam>(cloud);
        TensorVoter<TypeParam> voter(options_with(20));
        voter.set_fixed_voters(voters);
        TensorField<TypeParam> field;
        for (const int step : {1, 11}) voter.vote(step, g, field);
        return read(field, voter);
    };
    const auto splats = [&](float height, float noise) {
        Cloud cloud;
        for (int i = 0; i < 500; ++i)
            cloud.add(
                {random.uniform(-1, 1), random.uniform(-1, 1), height + noise * random.normal()},
                {0.08f, 0.08f, 0.08f}, random.quat());
        return cloud;
    };
    const auto height = [](const FieldOnHost& f) {
        double sum = 0;
        for (const Vec3f p : f.targets) sum += std::abs(double(p.z));
        return sum / double(f.targets.size());
    };
    // Splats that all lie off the plane agree with each other; only the points pull them back.
    const Cloud cloud = splats(0.05f, 0.01f);
    const FieldOnHost without = run(cloud, {}), with = run(cloud, fixed);
    EXPECT_GT(height(without), 0.9 * 0.05);
    EXPECT_LT(height(with), 0.75 * height(without));
    // Noisy splats near the plane get better normals.
    const Cloud noisy = splats(0, 0.01f);
    const std::vector<Vec3f> up(noisy.means.size(), {0, 0, 1});
    EXPECT_LT(median_normal_error(run(noisy, fixed), up),
              0.8 * median_normal_error(run(noisy, {}), up));
    // Fixed voters receive nothing and change no sizes; each casts k votes.
    EXPECT_EQ(with.flags.size(), cloud.means.size());
    EXPECT_EQ(with.details.voters.size(), (cloud.means.size() + 2000) * 20);
    EXPECT_TRUE(same_bits(with, run(cloud, fixed)));
    // With weight 0 they change only the counts.
    for (float& weight : fixed.weights) weight = 0;
    EXPECT_NEAR(height(run(cloud, fixed)), height(without), 1e-6);
}

TYPED_TEST(Voting, WarnsOnce) {
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
