// Closed form of one vote between two splats.  [docs/method/voting.md#one-vote]
#pragma once

#include <cmath>

#include "core/math/eigen.h"
#include "core/math/fast_math.h"
#include "core/math/vec.h"

namespace tvsgs {

inline constexpr double kLn10 = 2.302585092994046;
inline constexpr double kPi = 3.141592653589793;
inline constexpr double kWhitenNoise = 1e-4;  // of the (mean) trace: "0.01% of their average trace"
inline constexpr double kCoincident =
    1e-12;  // square of 1e-6: no direction is defined below this distance
// A vote is at most exp(-chord^2 / tau^2 - curvature term); beyond this exponent it is defined as
// zero. The limit is this large because the covariant vote of a giant splat counts even at a tiny
// decay; float still has normal numbers there.
inline constexpr double kMaxExponent = 80;
inline constexpr double kMinEigenvalue = 1e-30;  // smaller tensors carry no information in float
inline constexpr double kMinNormalGap =
    1e-3;  // minimum of (lambda_2 - lambda_3) / lambda_1 for an unambiguous normal
// Below this gap float rounding of the sums decides the normal, so the splat does not vote.
inline constexpr double kMinVotingGap = 1e-5;
inline constexpr double kStrongVote = 1e-3;  // decay above which tv.min_votes counts a vote
// Margin by which a saliency must be larger, as a share of lambda_1: some 80 times float's epsilon.
inline constexpr float kRoundingMargin = 1e-5f;

/// Options of the whitening; see TvOptions.
struct WhitenRule {
    bool whiten = true;
    bool per_splat_noise = false;
    float flatness_limit = 0;
};

/// Options of the votes; see TvOptions.
struct VoteRule {
    bool unit_length = false;  // tv.vote_map = unit
    float max_sin2 =
        2;  // sin^2 of the largest vote angle; 2: no limit, even with rounding at 90 degrees
};

/// Raises scales below `limit` times the middle scale to that value.
template <class Real>
TVSGS_HD Vec3<Real> limit_flatness(Vec3<Real> s, Real limit) {
    const Real low = s.x < s.y ? s.x : s.y, high = s.x < s.y ? s.y : s.x;
    const Real middle = s.z < low ? low : s.z > high ? high : s.z;
    const Real least = limit * middle;
    return {s.x < least ? least : s.x, s.y < least ? least : s.y, s.z < least ? least : s.z};
}

/// The space in which the voter is a unit sphere.
template <class Real>
struct Whitening {
    Mat3<Real> R;           // world_from_gaussian
    Vec3<Real> deviations;  // S': sqrt(s^2 + noise)
};

/// `noise`: global regulariser, world units squared; not read if the rule is per splat.
template <class Real>
TVSGS_HD Whitening<Real> whitening(Quat<Real> quat,
                                   Vec3<Real> scales,
                                   const WhitenRule& rule,
                                   Real noise) {
    Vec3<Real> s = limit_flatness(scales, Real(rule.flatness_limit));
    const Real trace = dot(s, s);
    if (rule.per_splat_noise) noise = Real(kWhitenNoise) * trace / 3;
    Vec3<Real> variances = s * s;
    if (!rule.whiten) variances = {trace / 3, trace / 3, trace / 3};
    return {rotation(normalize(quat)),
            {std::sqrt(variances.x + noise), std::sqrt(variances.y + noise),
             std::sqrt(variances.z + noise)}};
}

/// S'^-1 R^T: M up to a rotation, so lengths and angles agree. [docs/method/voting.md#one-vote]
template <class Real>
TVSGS_HD Mat3<Real> whitened_from_world(const Whitening<Real>& w) {
    Mat3<Real> W;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) W[i][j] = w.R[j][i] / w.deviations[i];
    return W;
}

/// Two unit vectors that are orthogonal to the unit vector `n` and to each other, without a branch.
template <class Real>
TVSGS_HD void orthonormal_basis(Vec3<Real> n, Vec3<Real>& a, Vec3<Real>& b) {
    const Real sign = n.z < 0 ? Real(-1) : Real(1), c = -1 / (sign + n.z), xy = n.x * n.y * c;
    a = {1 + sign * n.x * n.x * c, sign * xy, -sign * n.x};
    b = {xy, sign + n.y * n.y * c, -n.y};
}

/// The factor c kappa^2 / tau^2 of (sin theta / L)^2 in a vote's exponent; L is the whitened
/// distance. At the median distance a vote at 45 degrees has a tenth of a straight vote's strength.
/// This distance is tau / tau_per_median if scale-free, else 2, as in the paper.
template <class Real>
TVSGS_HD Real curvature_factor(bool scale_free, Real tau, Real tau_per_median) {
    const Real median = scale_free ? tau / tau_per_median : Real(2);
    return Real(16 * kLn10 / (kPi * kPi)) * median * median;
}

/// A voter. inverse_tau2 = 0: it is silent. normal_world = 0: it votes as a ball.
template <class Real>
struct alignas(16) VoterRecord {
    Vec3<Real> mean;
    Real inverse_tau2;
    Mat3<Real> W;             // whitened_from_world; a plate's normal is the third axis
    Vec3<Real> normal_world;  // the third axis mapped back by the inverse whitening
    Real strength;
    Real curvature;  // curvature_factor()
};

/// False if tau is zero or not finite, or if its square overflows.
template <class Real>
TVSGS_HD bool can_vote(const VoterRecord<Real>& voter) {
    return voter.inverse_tau2 > 0;
}
template <class Real>
TVSGS_HD Real inverse_square_or_zero(Real tau) {
    const Real inverse = 1 / (tau * tau);
    return tau > 0 && inverse > 0 && inverse * 0 == 0 ? inverse : Real(0);
}

/// Returns the record, or zeros if a number is not finite, else sums would be NaN at decay 0.
template <class Real>
TVSGS_HD VoterRecord<Real> silent_unless_finite(const VoterRecord<Real>& voter) {
    const Vec3<Real> m = voter.mean, n = voter.normal_world;
    Real zero = m.x * 0 + m.y * 0 + m.z * 0 + n.x * 0 + n.y * 0 + n.z * 0;
    zero += voter.inverse_tau2 * 0 + voter.strength * 0 + voter.curvature * 0;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) zero += voter.W[i][j] * 0;
    return zero == 0 ? voter : VoterRecord<Real>{};
}

/// Record of a voter; silent if it is not finite. `normal`: unit, world; zero for a ball. W is
/// S'^-1 R^T up to a rotation, which makes a plate's normal the third axis. So the third row of W
/// is normal / |S' R^T normal|, and its direction has no rounding from R and S'.
template <class Real>
TVSGS_HD VoterRecord<Real> voter_record(Vec3<Real> mean,
                                        const Whitening<Real>& w,
                                        Real tau,
                                        Vec3<Real> normal,
                                        Real strength,
                                        Real curvature) {
    VoterRecord<Real> voter{
        mean, inverse_square_or_zero(tau), whitened_from_world(w), {}, strength, curvature};
    const Vec3<Real> n = w.deviations * transpose_times(w.R, normal);
    const Real length = norm(n);
    if (length > 0) {
        const Vec3<Real> axis = n / length;
        voter.normal_world = w.R * (w.deviations * axis);
        const Vec3<Real> inverse{1 / w.deviations.x, 1 / w.deviations.y, 1 / w.deviations.z};
        Vec3<Real> a, b;
        orthonormal_basis(axis, a, b);
        const Vec3<Real> rows[3] = {w.R * (inverse * a), w.R * (inverse * b), normal / length};
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) voter.W[i][j] = rows[i][j];
    }
    return silent_unless_finite(voter);
}

template <class To>
TVSGS_HD VoterRecord<To> record_cast(const VoterRecord<double>& r) {
    return silent_unless_finite(VoterRecord<To>{
        vec_cast<To>(r.mean), static_cast<To>(r.inverse_tau2), mat_cast<To>(r.W),
        vec_cast<To>(r.normal_world), static_cast<To>(r.strength), static_cast<To>(r.curvature)});
}

/// The vote of one voter for one receiver.
template <class Real>
struct Vote {
    decltype(Real{} > Real{}) cast{};  // false: degenerate geometry or a silent voter, not counted
    Real decay{};                      // V, in [0, 1]
    Vec3<Real> v{};  // the vote is strength * decay * v v^T, divided by |v|^2 for unit votes
    Real inverse_length2{1};  // 1 / |v|^2 for unit votes, else 1
};

/// Square of arc / chord of a vote with this sine and cosine of its angle to the voter's plane:
/// arccos(c)^2 / (1 - c^2), by a polynomial with a relative error of 2e-7 including rounding.
template <class Real>
TVSGS_HD Real arc_factor2(Real sine, Real cosine) {
    if constexpr (kIsDouble<Real>) {
        using std::atan2;
        const Real theta = atan2(sine, cosine), theta2 = theta * theta;
        const Real factor =
            select(theta < Real(1e-2), 1 + theta2 / 6 + 7 * theta2 * theta2 / 360, theta / sine);
        return factor * factor;
    } else {
        const Real x = cosine - 0.5f;
        return 1.46216374f +
               x * (-1.27498118f +
                    x * (0.95248669f +
                         x * (-0.67786331f +
                              x * (0.47270626f +
                                   x * (-0.32542951f +
                                        x * (0.21339383f +
                                             x * (-0.14347438f +
                                                  x * (0.13736689f + x * -0.0954665f))))))));
    }
}

template <class Math, class Real, class Condition>
TVSGS_HD Vote<Real> scaled_vote(Condition cast, Real decay, Vec3<Real> v, const VoteRule& rule) {
    const Real least(1e-37f);  // its inverse is finite
    return {cast, decay, v, rule.unit_length ? Math::inverse(maximum(dot(v, v), least)) : Real(1)};
}

// Votes branch only by select(), so that a Pack of votes can be computed at once. If no vote is
// cast, the quotients have any value, and the final select() drops them.

/// `d`: receiver - voter.mean in the world; `dw` = W d.
template <class Math, class Real>
TVSGS_HD Vote<Real> ball_vote(const VoterRecord<Real>& voter,
                              Vec3<Real> d,
                              Vec3<Real> dw,
                              const VoteRule& rule) {
    const Real none(0), l2 = dot(dw, dw), exponent = voter.inverse_tau2 * l2;
    const auto cast = exponent > Real(kCoincident);
    const auto reaches = both(cast, exponent <= Real(kMaxExponent));
    return scaled_vote<Math>(cast, select(reaches, Math::decay(exponent), none),
                             select(reaches, Math::inverse_sqrt(l2), none) * d, rule);
}

/// The same arguments as ball_vote(), for a voter with a normal.
template <class Math, class Real>
TVSGS_HD Vote<Real> plate_vote(const VoterRecord<Real>& voter,
                               Vec3<Real> d,
                               Vec3<Real> dw,
                               const VoteRule& rule) {
    using std::abs;
    const Real u = dw.z, t2 = dw.x * dw.x + dw.y * dw.y, l2 = t2 + u * u;
    const Real inverse_l = Math::inverse_sqrt(l2), inverse_l2 = inverse_l * inverse_l;
    const Real inverse_t = Math::inverse_sqrt(t2);
    const Real sin2 = u * u * inverse_l2, cos2 = t2 * inverse_l2;
    const Real chord = voter.inverse_tau2 * l2;
    const Real curvature = voter.curvature * sin2 * inverse_l2;
    const auto cast = both(both(chord > Real(kCoincident), cos2 > Real(kCoincident)),
                           sin2 <= Real(rule.max_sin2));
    const auto reaches = both(cast, chord + curvature <= Real(kMaxExponent));
    const Real t = t2 * inverse_t;
    const Real arc2 = arc_factor2(abs(u) * inverse_l, t * inverse_l);
    // [cos 2 theta, sin 2 theta] in (tangent, normal), mapped back without a matrix product.
    const Real a = (cos2 - sin2) * inverse_t, b = u * (2 * (t * inverse_l2) - a);
    const Real none(0);
    return scaled_vote<Math>(
        cast, select(reaches, Math::decay(chord * arc2 + curvature), none),
        select(reaches, a, none) * d + select(reaches, b, none) * voter.normal_world, rule);
}

/// The sums of one receiver. A vote of strength 0 does not count.
template <class Real>
struct VoteSums {
    Sym3<Real> tensor{};
    Real squares{};  // of strength * decay
    Real votes{};
    Real strong{};  // votes with a decay above kStrongVote
};

template <class Real>
TVSGS_HD void add_vote(VoteSums<Real>& sums, Real strength, const Vote<Real>& vote) {
    const Real w = strength * vote.decay;
    add_outer(sums.tensor, w * vote.inverse_length2, vote.v);
    sums.squares += w * w;
    const auto heard = strength > Real(0);
    sums.votes += select(both(vote.cast, heard), Real(1), Real(0));
    sums.strong += select(both(vote.decay > Real(kStrongVote), heard), Real(1), Real(0));
}

/// Eigenvalues and normal of a sum of votes. Computed in double on both devices, because a flat
/// voter magnifies the error of its normal a hundredfold in the next round.
struct VotedTensor {
    bool valid = false, has_normal = false;  // finite and not 0; the normal is not ambiguous
    Vec3f values{}, normal{};                // descending; unit, of the smallest eigenvalue
};
TVSGS_HD inline VotedTensor voted_tensor(const Sym3f& T) {
    const SymEigen3<double> e = sym_eigen(Sym3<double>{T.xx, T.xy, T.xz, T.yy, T.yz, T.zz});
    const double finite = (e.values.x + e.values.y + e.values.z) * 0;
    if (finite != 0 || !(e.values.x >= kMinEigenvalue)) return {};
    return {true, (e.values.y - e.values.z) / e.values.x >= kMinNormalGap,
            vec_cast<float>(e.values), vec_cast<float>(column(e.vectors, 2))};
}

}  // namespace tvsgs
