// Tests voting events on clouds with known results, for each device.
#include "tv/tv_support.h"
#include "tv/voting.h"

namespace tvsgs::test {
namespace {

template <class Device>
class Voting : public ::testing::Test {};
TYPED_TEST_SUITE(Voting, Devices);

double median_normal_error(const FieldOnHost& f, const std::vector<Vec3f>& normals) {
    std::vector<double> errors;
    for (std::size_t i = 0; i < normals.size(); ++i)
        errors.push_back(angle_deg(f.normals[i], normals[i]));
    return median_of(errors);
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

}  // namespace
}  // namespace tvsgs::test
