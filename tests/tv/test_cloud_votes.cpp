// Votes between points: normals against known surfaces and against planes through neighbours,
// moved points, dropped outliers, blocks, and clouds without a surface.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>

#include "core/device/cuda_device.h"
#include "core/math/eigen.h"
#include "tv/cloud_votes.h"
#include "tv/vote_math.h"

namespace tvsgs {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// Points on a surface with its normals, then outliers in a larger box.
struct Surface {
    PointCloud cloud;  // without normals
    std::vector<Vec3f> normals;
    float spacing = 0;
};

class Sampler {
public:
    float uniform() { return uniform_(random_); }
    Vec3f in_box(float half) {
        const float x = uniform(), y = uniform(), z = uniform();
        return {half * (2 * x - 1), half * (2 * y - 1), half * (2 * z - 1)};
    }
    Vec3f noise(float size) {
        const float x = normal_(random_), y = normal_(random_), z = normal_(random_);
        return {size * x, size * y, size * z};
    }

private:
    std::mt19937 random_{7};
    std::uniform_real_distribution<float> uniform_{0, 1};
    std::normal_distribution<float> normal_{0, 1};
};

/// `noise` in spacings.
Surface sphere(int count, float noise, int outliers = 0) {
    Sampler sampler;
    Surface s;
    s.spacing = std::sqrt(4 * 3.14159f / static_cast<float>(count));
    for (int i = 0; i < count; ++i) {
        s.normals.push_back(normalize(sampler.noise(1)));
        s.cloud.positions.push_back(s.normals.back() + sampler.noise(noise * s.spacing));
    }
    for (int i = 0; i < outliers; ++i) s.cloud.positions.push_back(sampler.in_box(1.3f));
    return s;
}
Surface plane(int count, float noise) {
    Sampler sampler;
    Surface s;
    s.spacing = 2 / std::sqrt(static_cast<float>(count));
    for (int i = 0; i < count; ++i) {
        const Vec3f p = sampler.in_box(1), n = sampler.noise(noise * s.spacing);
        s.cloud.positions.push_back({p.x, p.y, n.z});
        s.normals.push_back({0, 0, 1});
    }
    return s;
}

/// All sides of the cube of half-length 1.
Surface box(int count, float noise) {
    Sampler sampler;
    Surface s;
    s.spacing = std::sqrt(24 / static_cast<float>(count));
    for (int i = 0; i < count; ++i) {
        Vec3f p = sampler.in_box(1), n{};
        n[i % 3] = i % 2 == 0 ? -1.0f : 1.0f, p[i % 3] = n[i % 3];
        s.normals.push_back(n);
        s.cloud.positions.push_back(p + sampler.noise(noise * s.spacing));
    }
    return s;
}

/// Normals of the planes through each point and its k nearest.
std::vector<Vec3f> plane_normals(const std::vector<Vec3f>& points, int k) {
    std::vector<Vec3f> normals, near = points;
    for (const Vec3f p : points) {
        std::nth_element(near.begin(), near.begin() + k, near.end(),
                         [p](Vec3f a, Vec3f b) { return dot(a - p, a - p) < dot(b - p, b - p); });
        Vec3d middle{};
        for (int i = 0; i <= k; ++i) middle += vec_cast<double>(near[i]) / double(k + 1);
        Sym3<double> T{};
        for (int i = 0; i <= k; ++i) add_outer(T, 1.0, vec_cast<double>(near[i]) - middle);
        normals.push_back(vec_cast<float>(column(sym_eigen(T).vectors, 2)));
    }
    return normals;
}

float radius_error(Vec3f p) {
    return std::abs(norm(p) - 1);
}

/// Mean angle in degrees to the known normals, of any sign.
double mean_angle(const std::vector<Vec3f>& normals, const Surface& s) {
    double sum = 0;
    for (std::size_t i = 0; i < s.normals.size(); ++i)
        sum += std::acos(std::min(1.0, std::abs(double(dot(normals[i], s.normals[i])))));
    return sum / static_cast<double>(s.normals.size()) * 180 / 3.14159265;
}

CloudVotes votes_of(const PointCloud& cloud, const CloudVoteOptions& options = {}) {
    return vote_in_cloud(Cpu{}, cloud, options);
}

template <class T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}
void expect_same(const CloudVotes& a, const CloudVotes& b) {
    EXPECT_TRUE(same_bits(a.kept, b.kept));
    EXPECT_TRUE(same_bits(a.positions, b.positions));
    EXPECT_TRUE(same_bits(a.normals, b.normals));
    EXPECT_TRUE(same_bits(a.eigenvalues, b.eigenvalues));
    EXPECT_TRUE(same_bits(a.confidences, b.confidences));
    EXPECT_TRUE(same_bits(a.order, b.order));
    EXPECT_TRUE(same_bits(a.nearest, b.nearest));
}

/// Without moves before the votes the noisy planes fail, without agreement the boxes.
TEST(CloudVotes, FindsNormals) {
    const Surface exact = sphere(3000, 0);
    EXPECT_LT(mean_angle(votes_of(exact.cloud).normals, exact), 1.25);
    const auto share_of_planes = [](const Surface& s) {
        return mean_angle(votes_of(s.cloud).normals, s) /
               mean_angle(plane_normals(s.cloud.positions, 30), s);
    };
    EXPECT_LT(share_of_planes(plane(2000, 0.25f)), 0.9);
    EXPECT_LT(share_of_planes(plane(2000, 1)), 0.55);
    EXPECT_LT(share_of_planes(box(2000, 0)), 0.9);
    EXPECT_LT(share_of_planes(box(2000, 0.1f)), 0.9);
}

/// Neighbours beyond a thin wall do not draw points to its other side.
TEST(CloudVotes, RefineKeepsThinWalls) {
    Surface s = plane(3000, 0);
    for (std::size_t i = 0; i < 3000; i += 2) s.cloud.positions[i].z = 4 * s.spacing;
    CloudVoteOptions options;
    options.refine = 3;
    const CloudVotes moved = votes_of(s.cloud, options);
    double off = 0;
    for (std::size_t i = 0; i < 3000; ++i)
        off += double(std::abs(moved.positions[i].z - s.cloud.positions[i].z));
    EXPECT_LT(off / 3000, 0.25 * double(s.spacing));
}

TEST(CloudVotes, SaliencyIsThatOfASurface) {
    const Surface s = plane(3000, 0);
    const CloudVotes votes = votes_of(s.cloud);
    double surface = 0, curve = 0, point = 0, confidence = 0;
    for (std::size_t i = 0; i < 3000; ++i) {
        surface += votes.surface(i), curve += votes.curve(i), point += votes.point(i);
        confidence += votes.confidences[i];
    }
    EXPECT_LT(point, 1e-4 * surface);
    EXPECT_LT(curve, 0.7 * surface);
    EXPECT_GT(confidence / 3000, 0.6);
    for (const float c : votes.confidences) EXPECT_TRUE(c >= 0 && c <= 1);
}

TEST(CloudVotes, RefineMovesPointsToTheSurface) {
    const Surface s = sphere(3000, 0.5f);
    CloudVoteOptions options;
    const CloudVotes still = votes_of(s.cloud, options);
    EXPECT_TRUE(same_bits(still.positions, s.cloud.positions));
    options.refine = 3;
    const CloudVotes moved = votes_of(s.cloud, options);
    double before = 0, after = 0;
    for (std::size_t i = 0; i < 3000; ++i) {
        before += radius_error(s.cloud.positions[i]), after += radius_error(moved.positions[i]);
        // At most one spacing per round; the nearest points of a few lie farther away.
        EXPECT_LT(norm(moved.positions[i] - s.cloud.positions[i]), 3 * 3 * s.spacing);
    }
    EXPECT_LT(after, 0.35 * before);
}

TEST(CloudVotes, RejectDropsOutliers) {
    const int count = 3000;
    const Surface s = sphere(count, 0.1f, count);
    CloudVoteOptions options;
    options.reject = true;
    const CloudVotes votes = votes_of(s.cloud, options);
    int surface = 0, far = 0, far_kept = 0;
    for (const std::size_t i : votes.kept)
        if (i < std::size_t(count))
            ++surface;
        else
            far_kept += radius_error(s.cloud.positions[i]) > 3 * s.spacing ? 1 : 0;
    for (std::size_t i = count; i < s.cloud.positions.size(); ++i)
        far += radius_error(s.cloud.positions[i]) > 3 * s.spacing ? 1 : 0;
    EXPECT_GT(surface, 0.97 * count);
    EXPECT_LT(far_kept, 0.1 * far);
    EXPECT_EQ(votes.positions.size(), votes.kept.size());
    EXPECT_TRUE(std::is_sorted(votes.kept.begin(), votes.kept.end()));
}

/// Neighbours that are searched again in each pass give the same bits, with all options.
TEST(CloudVotes, BlocksDoNotChangeTheResult) {
    const Surface s = sphere(2000, 0.3f, 500);
    CloudVoteOptions options;
    options.refine = 1, options.reject = true, options.k = 20;
    const CloudVotes whole = votes_of(s.cloud, options);
    options.block = 333;
    expect_same(votes_of(s.cloud, options), whole);
    options.list_bytes = 0;
    expect_same(votes_of(s.cloud, options), whole);
}

TEST(CloudVotes, ProgressReachesItsTotal) {
    const Surface s = sphere(500, 0.1f);
    for (const bool reject : {false, true}) {
        CloudVoteOptions options;
        options.reject = reject, options.refine = 3;
        double steps = 0;
        const CloudVotes votes = vote_in_cloud(Cpu{}, s.cloud, options, [&](int n) { steps += n; });
        const double dropped = 500 - static_cast<double>(votes.kept.size());
        EXPECT_EQ(steps, cloud_vote_steps(options, 500) - 10 * dropped);
    }
}

TEST(CloudVotes, InputNormalsVoteAndKeepTheirSide) {
    Surface s = plane(2000, 0);
    s.cloud.normals = s.normals;
    for (std::size_t i = 0; i < 2000; i += 3) s.cloud.normals[i] = {0, 0, -1};
    s.cloud.normals[1] = {};  // votes as a ball
    const CloudVotes votes = votes_of(s.cloud);
    for (std::size_t i = 0; i < 2000; ++i)
        if (i != 1) {
            EXPECT_GT(dot(votes.normals[i], s.cloud.normals[i]), 0.999f) << i;
        }
    EXPECT_GT(std::abs(votes.normals[1].z), 0.999f);
    // Sticks in the plane instead of across it: the votes follow the normals, not the places.
    for (Vec3f& n : s.cloud.normals) n = normalize(Vec3f{1, 0, 1});
    EXPECT_GT(mean_angle(votes_of(s.cloud).normals, s), 10);
}

/// Points without confidence do not vote.
TEST(CloudVotes, ConfidenceIsTheStrengthOfAVote) {
    Surface s = plane(1000, 0);
    Sampler sampler;
    for (int i = 0; i < 300; ++i) s.cloud.positions.push_back(0.3f * sampler.in_box(1));
    const double with = mean_angle(votes_of(s.cloud).normals, s);
    s.cloud.confidences.assign(1300, 1.0f);
    std::fill(s.cloud.confidences.begin() + 1000, s.cloud.confidences.end(), 0.0f);
    EXPECT_LT(mean_angle(votes_of(s.cloud).normals, s), 1e-3);
    EXPECT_GT(with, 0.1);
}

TEST(CloudVotes, RadiusLimitsTheVotes) {
    // Two planes, farther apart than the radius and nearer than many of the 120 neighbours.
    Surface s = plane(2000, 0);
    for (std::size_t i = 0; i < 2000; i += 2) s.cloud.positions[i].z = 4 * s.spacing;
    CloudVoteOptions options;
    options.k = 120;
    const double without = mean_angle(votes_of(s.cloud, options).normals, s);
    options.radius = 3.9f * s.spacing;
    EXPECT_LT(mean_angle(votes_of(s.cloud, options).normals, s), 0.01);
    EXPECT_GT(without, 0.1);
}

TEST(CloudVotes, OrientsNormals) {
    const Surface s = sphere(2000, 0.1f);
    CloudVotes votes = votes_of(s.cloud);
    orient_along_graph(votes);
    int outwards = 0, inwards = 0;
    for (std::size_t i = 0; i < 2000; ++i) outwards += dot(votes.normals[i], s.normals[i]) > 0;
    EXPECT_GT(outwards, 1990);
    orient_to_viewpoint(votes, {0, 0, 0});
    for (std::size_t i = 0; i < 2000; ++i) inwards += dot(votes.normals[i], s.normals[i]) < 0;
    EXPECT_GT(inwards, 1990);
}

TEST(CloudVotes, CloudsWithoutASurfaceGetNoNormals) {
    CloudVoteOptions options;
    for (const bool reject : {false, true}) {
        options.reject = reject;
        PointCloud cloud;
        EXPECT_TRUE(votes_of(cloud, options).kept.empty());
        const auto expect_none = [&] {
            CloudVotes votes = votes_of(cloud, options);
            orient_along_graph(votes);
            for (std::size_t i = 0; i < votes.kept.size(); ++i) {
                EXPECT_EQ(norm(votes.normals[i]), 0);
                EXPECT_EQ(votes.confidences[i], 0);
                EXPECT_TRUE(is_finite(votes.eigenvalues[i]) && is_finite(votes.positions[i]));
            }
        };
        cloud.positions = {{1, 2, 3}};
        expect_none();
        cloud.positions.assign(100, {1, 2, 3});
        expect_none();
        for (std::size_t i = 0; i < 100; ++i) cloud.positions[i].x = static_cast<float>(i);
        expect_none();
    }
}

TEST(CloudVotes, HugeAndTinyCoordinatesStayFinite) {
    for (const float scale : {1e-15f, 1e12f}) {
        Surface s = plane(500, 0);
        for (Vec3f& p : s.cloud.positions) p = scale * p;
        const CloudVotes votes = votes_of(s.cloud);
        EXPECT_LT(mean_angle(votes.normals, s), 0.01) << scale;
        for (const float c : votes.confidences) EXPECT_TRUE(c >= 0 && c <= 1);
    }
    Surface s = plane(500, 0);  // and one point far from all others
    s.cloud.positions.push_back({1e9f, 0, 0});
    EXPECT_LT(mean_angle(votes_of(s.cloud).normals, s), 0.01);
}

TEST(CloudVotes, BadNormalsAndConfidencesAreIgnored) {
    Surface s = plane(500, 0);
    s.cloud.normals.assign(500, {kInfinity - kInfinity, 0, 0});
    s.cloud.confidences.assign(500, 1.0f);
    s.cloud.confidences[0] = kInfinity - kInfinity;
    s.cloud.confidences[1] = -1;
    EXPECT_LT(mean_angle(votes_of(s.cloud).normals, s), 0.01);
}

TEST(CloudVotes, DevicesAgree) {
    if constexpr (kHasCuda) {
        if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
        const Surface s = sphere(3000, 0.2f, 300);
        std::vector<CloudVoteOptions> all(3);
        all[0].refine = 2;
        all[1].reject = true;
        all[2].block = 333, all[2].list_bytes = 0;  // many blocks, searched in each pass
        for (const CloudVoteOptions& options : all) {
            const CloudVotes cpu = votes_of(s.cloud, options);
            const CloudVotes cuda = vote_in_cloud(Cuda{}, s.cloud, options);
            ASSERT_EQ(cpu.kept, cuda.kept);
            int different = 0;
            for (std::size_t i = 0; i < cpu.kept.size(); ++i)
                different += norm(cpu.positions[i] - cuda.positions[i]) > 1e-3f * s.spacing ||
                             std::abs(cpu.confidences[i] - cuda.confidences[i]) > 1e-3f ||
                             norm(cpu.normals[i] - cuda.normals[i]) > 1e-2f;
            EXPECT_LT(different, 0.02 * static_cast<double>(cpu.kept.size()))
                << options.refine << options.reject << options.block;
        }
    } else {
        GTEST_SKIP() << "built without CUDA";
    }
}

}  // namespace
}  // namespace tvsgs
