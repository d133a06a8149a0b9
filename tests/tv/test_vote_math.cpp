// Tests the closed form of a vote against the formulas of the page, and its table of degenerate
// geometry. [docs/method/voting.md#one-vote, docs/method/voting.md#degenerate-geometry]
#include "core/math/fast_math.h"
#include "tv/internal/warp.h"
#include "tv/tv_support.h"
#include "tv/vote_math.h"

namespace tvsgs::test {
namespace {

using Vec = Vec3<double>;

/// The paper's constant.
const double kLiteral = curvature_factor(false, 1.0, 1.0);

struct Voter {
    Quat<double> quat;
    Vec scales, normal;
    double tau, noise;
    WhitenRule rule{};
    Vec mean{0.3, -0.2, 0.1};

    VoterRecord<double> record() const {
        return voter_record(mean, whitening(quat, scales, rule, noise), tau, normal, 0.7, kLiteral);
    }
    Vote<double> plate(Vec receiver, const VoteRule& vote_rule = {}) const {
        const auto r = record();
        return plate_vote<FastMath>(r, receiver - mean, r.W * (receiver - mean), vote_rule);
    }
    Vote<double> ball(Vec receiver, const VoteRule& vote_rule = {}) const {
        const auto r =
            voter_record(mean, whitening(quat, scales, rule, noise), tau, Vec{}, 1.0, kLiteral);
        return ball_vote<FastMath>(r, receiver - mean, r.W * (receiver - mean), vote_rule);
    }
};

Mat3<double> power(const Voter& v, double exponent) {  // Sigma'^exponent
    const Mat3<double> R = rotation(v.quat);
    Mat3<double> D;
    for (int i = 0; i < 3; ++i) D[i][i] = std::pow(v.scales[i] * v.scales[i] + v.noise, exponent);
    return R * D * transpose(R);
}

/// The formulas of [docs/method/voting.md#one-vote] unchanged, with symmetric matrices and the
/// angle.
Vec direct_plate_vote(const Voter& v, Vec receiver, double& decay) {
    const Mat3<double> M = power(v, -0.5), M_inverse = power(v, 0.5);
    const Vec d = M * (receiver - v.mean);
    const double L = norm(d);
    Vec n = transpose(M_inverse) * v.normal;
    n = n / norm(n);
    const double dn = dot(d, n);
    const Vec dt = d - dn * n;
    const double t = norm(dt), theta = std::atan2(std::abs(dn), t);
    const double arc = theta < 1e-2 ? L * (1 + theta * theta / 6 + 7 * std::pow(theta, 4) / 360)
                                    : L * theta / std::sin(theta);
    const double curvature = 2 * (std::abs(dn) / L) / L;
    const double c = 16 * kLn10 * v.tau * v.tau / (kPi * kPi);
    decay = std::exp(-(arc * arc + c * curvature * curvature) / (v.tau * v.tau));
    const Vec in_plane = (t * t - dn * dn) / (L * L) * (dt / t);
    return M_inverse * (in_plane + 2 * t * dn / (L * L) * n);
}

Voter random_voter(Random& random) {
    Voter v{};
    v.quat = normalize(quat_cast<double>(random.quat()));
    v.scales = {std::exp(random.normal()), std::exp(random.normal()),
                0.03 * std::exp(random.normal())};
    v.noise = 1e-4 * dot(v.scales, v.scales);
    v.normal = normalize(vec_cast<double>(random.normal3()));
    v.tau = std::exp(0.5 * double(random.normal()));
    return v;
}

TEST(VoteMath, ClosedFormIsTheVoteOfThePage) {
    Random random(1);
    int compared = 0;
    for (int trial = 0; trial < 5000; ++trial) {
        const Voter v = random_voter(random);
        const Vec receiver = v.mean + 0.7 * vec_cast<double>(random.normal3());
        const Vote<double> vote = v.plate(receiver);
        double decay = 0;
        const Vec direct = direct_plate_vote(v, receiver, decay);
        if (!vote.cast || vote.decay == 0) {
            EXPECT_LT(decay, 2e-35);
            continue;
        }
        ++compared;
        EXPECT_NEAR(vote.decay, decay, 1e-12 * std::max(decay, 0.01));
        const double sign = dot(vote.v, direct) < 0 ? -1 : 1;  // v v^T is independent of the sign
        // The direct form multiplies by a matrix and its inverse: condition up to 100.
        EXPECT_LT(norm(vote.v - sign * direct), 1e-12 * (1 + norm(v.scales))) << "trial " << trial;
    }
    EXPECT_GT(compared, 1000);
}

TEST(VoteMath, UnitVotesHaveLengthOne) {
    Random random(2);
    for (int trial = 0; trial < 100; ++trial) {
        const Voter v = random_voter(random);
        const Vec receiver = v.mean + 0.3 * vec_cast<double>(random.normal3());
        const auto plate = v.plate(receiver, {.unit_length = true}), covariant = v.plate(receiver);
        if (plate.decay == 0) continue;
        EXPECT_NEAR(dot(plate.v, plate.v) * plate.inverse_length2, 1, 1e-14);
        EXPECT_EQ(norm(plate.v - covariant.v), 0);
        EXPECT_EQ(covariant.inverse_length2, 1);
        EXPECT_EQ(plate.decay, covariant.decay);
    }
}

Voter unit_voter() {  // an isotropic unit ball with its normal along z
    return {{1, 0, 0, 0}, {1, 1, 1}, {0, 0, 1}, 1, 0, {}, {0, 0, 0}};
}

TEST(VoteMath, ByHand) {
    const Voter v = unit_voter();
    // Straight ahead: exp(-L^2 / tau^2) along x.
    const auto straight = v.plate({0.5, 0, 0});
    EXPECT_NEAR(straight.decay, std::exp(-0.25), 1e-15);
    EXPECT_NEAR(norm(straight.v - Vec{1, 0, 0}), 0, 1e-15);
    // 45 degrees: the circle's tangent there is the normal; arc (pi / 4) / sin 45, curvature sqrt 2
    // / L.
    const auto steep = v.plate({1, 0, 1});
    const double l2 = 2, arc2 = l2 * kPi * kPi / 8, curvature2 = 2 / l2;
    EXPECT_NEAR(steep.decay, std::exp(-arc2 - 16 * kLn10 / (kPi * kPi) * curvature2), 1e-15);
    EXPECT_NEAR(norm(steep.v - Vec{0, 0, 1}), 0, 1e-14);
    // A straight vote at the median distance has a tenth of full strength when tau = median /
    // sqrt(ln 10).
    EXPECT_NEAR(v.plate({std::sqrt(kLn10), 0, 0}).decay, 0.1, 1e-15);
    // Balls: V = exp(-L^2 / tau^2) along d.
    const auto ball = v.ball({0, 0.3, 0.4});
    EXPECT_NEAR(ball.decay, std::exp(-0.25), 1e-15);
    EXPECT_NEAR(norm(ball.v - Vec{0, 0.6, 0.8}), 0, 1e-15);
}

TEST(VoteMath, SinglePrecisionIsTheSameVote) {
    // Inner loops in float use one-instruction functions and a polynomial for the arc. The error of
    // the decay is the error of the exponent (up to 28, in units of 6e-8) plus that of the
    // polynomial.
    Random random(3);
    int compared = 0;
    for (int trial = 0; trial < 5000; ++trial) {
        Voter v = random_voter(random);
        v.scales.z = v.scales.x;  // test_twins.cpp covers the conditioning
        const Vec receiver = v.mean + 0.7 * vec_cast<double>(random.normal3());
        const auto rule = VoteRule{.unit_length = trial % 2 == 0};
        const Vote<double> vote = v.plate(receiver, rule);
        const auto w =
            whitening(quat_cast<float>(v.quat), vec_cast<float>(v.scales), v.rule, float(v.noise));
        const auto r = voter_record(vec_cast<float>(v.mean), w, float(v.tau),
                                    vec_cast<float>(v.normal), 0.7f, float(kLiteral));
        const Vec3f d = vec_cast<float>(receiver) - r.mean;
        const Vote<float> single = plate_vote<FastMath>(r, d, r.W * d, rule);
        if (vote.decay < 1e-6) continue;
        ++compared;
        // Nearly straight votes at short range lose most precision: their curvature term is a
        // quotient of small numbers.
        EXPECT_NEAR(single.decay / vote.decay, 1, 1e-4) << "trial " << trial;
        const double length = norm(vote.v);
        EXPECT_LT(norm(cross(vec_cast<double>(single.v), vote.v)), 1e-5 * length * length);
        EXPECT_NEAR(single.inverse_length2 / vote.inverse_length2, 1, 2e-5);
    }
    EXPECT_GT(compared, 1000);
}

TEST(VoteMath, ArcOfAllAngles) {
    for (int i = 0; i <= 1000; ++i) {
        const double theta = kPi / 2 * i / 1000, sine = std::sin(theta), cosine = std::cos(theta);
        const double wanted = i == 0 ? 1 : theta / sine;
        const double square = wanted * wanted;
        EXPECT_NEAR(arc_factor2(sine, cosine), square, 1e-9 * square);
        EXPECT_NEAR(arc_factor2(float(sine), float(cosine)), square, 5e-7 * square);
    }
}

TEST(VoteMath, RecordsBeyondFloatAddNothing) {
    for (int entry = 0; entry < 3; ++entry) {
        VoterRecord<double> r = unit_voter().record();
        (entry == 0 ? r.normal_world.x : entry == 1 ? r.W[1][2] : r.strength) = 1e200;
        const VoterRecord<float> single = record_cast<float>(r);
        EXPECT_FALSE(can_vote(single));
        const Vec3f d{0.1f, 0.2f, 0.3f};
        VoteSums<float> sums;
        add_vote(sums, single.strength, plate_vote<FastMath>(single, d, single.W * d, {}));
        EXPECT_EQ(sums.tensor.xx + sums.tensor.yy + sums.tensor.zz + sums.votes, 0);
    }
}

TEST(VoteMath, CoincidentPoints) {
    const Voter v = unit_voter();
    EXPECT_FALSE(v.plate({0.9e-6, 0, 0}).cast);
    EXPECT_TRUE(v.plate({1.1e-6, 0, 0}).cast);
    EXPECT_FALSE(v.ball({0, 0, 0.9e-6}).cast);
    EXPECT_TRUE(v.ball({0, 0, 1.1e-6}).cast);
    EXPECT_FALSE(v.plate({0, 0, 0}).cast);
}

TEST(VoteMath, ReceiverOnTheNormal) {
    const Voter v = unit_voter();
    EXPECT_FALSE(v.plate({0, 0, 0.5}).cast);
    EXPECT_FALSE(v.plate({0.4e-6, 0, 0.5}).cast);
    EXPECT_TRUE(v.plate({0.6e-6, 0, 0.5}).cast);
    EXPECT_TRUE(v.ball({0, 0, 0.5}).cast);
}

TEST(VoteMath, SilentScalesOfVoting) {
    for (const double tau : {0.0, std::nan(""), HUGE_VAL, -1.0, 1e-200}) {
        Voter v = unit_voter();
        v.tau = tau;
        EXPECT_FALSE(can_vote(v.record())) << tau;
        EXPECT_FALSE(v.plate({0.5, 0, 0}).cast) << tau;
        EXPECT_FALSE(v.ball({0.5, 0, 0}).cast) << tau;
    }
}

TEST(VoteMath, LargeAnglesAreWeakAndCanBeCut) {
    const Voter v = unit_voter();
    const auto vote = v.plate({0.5, 0, 0.6});  // 50 degrees
    EXPECT_TRUE(vote.cast);
    EXPECT_LT(vote.decay, 0.1 * v.plate({0.5, 0, 0}).decay);
    const float sine = static_cast<float>(std::sin(45 * kPi / 180));
    EXPECT_FALSE(v.plate({0.5, 0, 0.6}, {.unit_length = false, .max_sin2 = sine * sine}).cast);
    EXPECT_TRUE(v.plate({0.5, 0, 0.4}, {.unit_length = false, .max_sin2 = sine * sine}).cast);
}

TEST(VoteMath, FarVotesAreZeroAndCounted) {
    const Voter v = unit_voter();
    const double cut = std::sqrt(kMaxExponent);
    EXPECT_GT(v.plate({cut * 0.999, 0, 0}).decay, 0);
    EXPECT_TRUE(v.plate({cut * 1.001, 0, 0}).cast);
    EXPECT_EQ(v.plate({cut * 1.001, 0, 0}).decay, 0);
    EXPECT_EQ(v.ball({cut * 1.001, 0, 0}).decay, 0);
}

TEST(VoteMath, NotANumberIsNotCast) {
    const Voter v = unit_voter();
    EXPECT_FALSE(v.plate({std::nan(""), 0, 0}).cast);
    EXPECT_FALSE(v.ball({0, std::nan(""), 0}).cast);
}

TEST(VoteMath, NeedlesStayFinite) {
    for (const Vec scales : {Vec{1, 1, 1e-6}, {1, 1e-6, 1e-6}}) {
        Voter v = unit_voter();
        v.scales = scales;
        v.noise = kWhitenNoise * dot(scales, scales);
        const auto M = whitened_from_world(whitening(v.quat, v.scales, v.rule, v.noise));
        double largest = 0;
        for (int i = 0; i < 3; ++i) largest = std::max(largest, M[i][i]);
        // Condition of M: sqrt(1 + s_max^2 / eps), s_max = 1.
        EXPECT_LE(largest / std::min({M[0][0], M[1][1], M[2][2]}),
                  std::sqrt(1 + 1 / v.noise) * (1 + 1e-12));
        EXPECT_TRUE(can_vote(v.record()) && is_finite(v.record().normal_world));
    }
}

TEST(VoteMath, FlatnessLimitRaisesThinScalesToTheMiddleOne) {
    EXPECT_EQ(limit_flatness(Vec{1, 0.1, 0.5}, 1.0).y, 0.5);
    EXPECT_EQ(limit_flatness(Vec{0.1, 1, 0.5}, 0.5).x, 0.25);
    EXPECT_EQ(limit_flatness(Vec{0.1, 1, 0.5}, 0.0).x, 0.1);
    EXPECT_EQ(limit_flatness(Vec{0.5, 0.1, 1}, 1.0).z, 1);
}

TEST(VoteMath, MedianOfEvenCountsIsTheMeanOfTheMiddleTwo) {
    float scratch[4];
    const auto median = [&](const std::vector<float>& values) {
        return SerialWarp{}.median(static_cast<int>(values.size()), scratch,
                                   [&](int i) { return values[std::size_t(i)]; });
    };
    EXPECT_EQ(median({5, 1, 3}), 3);
    EXPECT_EQ(median({7, 1, 3, 5}), 4);
    EXPECT_EQ(median({4}), 4);
    EXPECT_EQ(median({4, std::nanf(""), 1}), 4);  // NaN comes last
}

}  // namespace
}  // namespace tvsgs::test
