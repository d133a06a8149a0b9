// One vote between two splats in closed form.  [tensor voting specification, sections 2 and 3]
#pragma once

#include <cmath>

#include "core/vec.h"

namespace tvsgs {

inline constexpr double kLn10 = 2.302585092994046;
inline constexpr double kPi = 3.141592653589793;
inline constexpr double kWhitenNoise = 1e-4;  // of the (mean) trace: "0.01% of their average trace"
inline constexpr double kCoincident =
    1e-12;  // squares of the 1e-6 below which no direction is defined
// Arc >= chord bounds a vote by exp(-chord^2 / tau^2 - the curvature's part): past this exponent it
// is below 1e-12, and defined as zero.
inline constexpr double kMaxExponent = 28;
inline constexpr double kMinEigenvalue =
    1e-30;  // a tensor below this carries no information in float
inline constexpr double kMinNormalGap =
    1e-3;  // (lambda_2 - lambda_3) / lambda_1 of an unambiguous normal
inline constexpr double kStrongVote = 1e-3;  // what tv.min_votes counts

struct WhitenRule {
    bool whiten = true;
    bool per_splat_noise = false;
    float flatness_limit = 0;
};

struct VoteRule {
    bool unit_length = false;  // tv.vote_map = unit
    float max_sin2 =
        2;  // sine squared of the largest vote angle; 2: no limit, free of rounding at 90 degrees
};

/// No scale counts as thinner than `limit` times the middle one.
template <class Real>
TVSGS_HD Vec3<Real> limit_flatness(Vec3<Real> s, Real limit) {
    const Real low = s.x < s.y ? s.x : s.y, high = s.x < s.y ? s.y : s.x;
    const Real middle = s.z < low ? low : s.z > high ? high : s.z;
    const Real least = limit * middle;
    return {s.x < least ? least : s.x, s.y < least ? least : s.y, s.z < least ? least : s.z};
}

/// The space in which the voter is a unit ball.
template <class Real>
struct Whitening {
    Mat3<Real> R;           // world_from_gaussian
    Vec3<Real> deviations;  // S': sqrt(s^2 + noise)
};

/// `noise`: the global regulariser, world units squared; not read where the rule says per splat.
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

/// S'^-1 R^T: the symmetric M of the specification up to a rotation, so lengths and angles are the
/// same.
template <class Real>
TVSGS_HD Mat3<Real> whitened_from_world(const Whitening<Real>& w) {
    Mat3<Real> W;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) W[i][j] = w.R[j][i] / w.deviations[i];
    return W;
}

/// All that the votes of one splat depend on. Silent voters have inverse_tau2 = 0, ball voters
/// normal = 0.
template <class Real>
struct alignas(16) VoterRecord {
    Vec3<Real> mean;
    Mat3<Real> W;             // whitened_from_world
    Vec3<Real> normal;        // n': unit normal of the plate, whitened space
    Vec3<Real> normal_world;  // R S' n': where the inverse whitening takes n'
    Real inverse_tau2;
    Real strength;
};

/// False for tau that is zero, not finite, or whose square leaves the range.
template <class Real>
TVSGS_HD bool can_vote(const VoterRecord<Real>& voter) {
    return voter.inverse_tau2 > 0;
}
template <class Real>
TVSGS_HD bool is_ball(const VoterRecord<Real>& voter) {
    return dot(voter.normal, voter.normal) == 0;
}

template <class Real>
TVSGS_HD Real inverse_square_or_zero(Real tau) {
    const Real inverse = 1 / (tau * tau);
    return tau > 0 && inverse > 0 && inverse * 0 == 0 ? inverse : Real(0);
}

/// Sets what depends on the voter's tensor. `normal`: unit, world; zero for a ball voter.
template <class Real>
TVSGS_HD void set_orientation(VoterRecord<Real>& voter,
                              const Whitening<Real>& w,
                              Vec3<Real> normal,
                              Real strength) {
    const Vec3<Real> n = w.deviations * transpose_times(w.R, normal);
    const Real length = norm(n);
    voter.normal = length > 0 ? n / length : Vec3<Real>{};
    voter.normal_world = w.R * (w.deviations * voter.normal);
    voter.strength = strength;
}

template <class Real>
struct Vote {
    bool cast = false;  // false: degenerate geometry or a silent voter, not even counted
    Real decay{};       // V, in [0, 1]
    Vec3<Real> v{};     // the vote is strength * decay * v v^T
};

namespace detail {
template <class Real>
TVSGS_HD Vec3<Real> mapped(Vec3<Real> v, const VoteRule& rule) {
    if (!rule.unit_length) return v;
    const Real length = norm(v);
    return length > 0 ? v / length : v;
}
}  // namespace detail

/// `d`: receiver - voter.mean in the world; `dw`: the same in the whitened space.
template <class Real>
TVSGS_HD Vote<Real> ball_vote(const VoterRecord<Real>& voter,
                              Vec3<Real> d,
                              Vec3<Real> dw,
                              const VoteRule& rule) {
    const Real l2 = dot(dw, dw), exponent = voter.inverse_tau2 * l2;
    if (!(exponent > Real(kCoincident))) return {};
    if (!(exponent <= Real(kMaxExponent))) return {true, 0, {}};
    return {true, std::exp(-exponent), detail::mapped(d / std::sqrt(l2), rule)};
}

template <class Real>
TVSGS_HD Vote<Real> plate_vote(const VoterRecord<Real>& voter,
                               Vec3<Real> d,
                               Vec3<Real> dw,
                               const VoteRule& rule) {
    const Real l2 = dot(dw, dw), exponent = voter.inverse_tau2 * l2;
    if (!(exponent > Real(kCoincident))) return {};
    const Real u = dot(dw, voter.normal);
    const Vec3<Real> tangent = dw - u * voter.normal;  // l2 - u^2 would cancel
    const Real t2 = dot(tangent, tangent), x = u * u / l2;
    if (!(t2 > Real(kCoincident) * l2) || x > Real(rule.max_sin2)) return {};
    const Real curvature_exponent = Real(16 * kLn10 / (kPi * kPi)) * 4 * x / l2;
    if (!(exponent + curvature_exponent <= Real(kMaxExponent))) return {true, 0, {}};
    const Real t = std::sqrt(t2), theta = std::atan2(std::abs(u), t), theta2 = theta * theta;
    // (theta / sin theta)^2, and its series where both vanish.
    const Real series = 1 + theta2 / 6 + 7 * theta2 * theta2 / 360;
    const Real arc2 = theta < Real(1e-2) ? series * series : theta2 / x;
    const Real decay = std::exp(-(exponent * arc2 + curvature_exponent));
    // [cos 2 theta, sin 2 theta] in (tangent, n'), mapped back to the world without a matrix
    // product.
    const Real a = (1 - 2 * x) / t, b = 2 * u * t / l2 - a * u;
    return {true, decay, detail::mapped(a * d + b * voter.normal_world, rule)};
}

/// What a receiver adds up.
template <class Real>
struct VoteSums {
    Sym3<Real> tensor{};
    Real squares{};  // of strength * decay
    Real votes{};
    Real strong{};  // votes with a decay over kStrongVote
};

template <class Real>
TVSGS_HD void add_outer(Sym3<Real>& T, Real w, Vec3<Real> v) {
    const Vec3<Real> wv = w * v;
    T.xx += wv.x * v.x, T.xy += wv.x * v.y, T.xz += wv.x * v.z;
    T.yy += wv.y * v.y, T.yz += wv.y * v.z, T.zz += wv.z * v.z;
}
template <class Real>
TVSGS_HD void add_vote(VoteSums<Real>& sums, Real strength, const Vote<Real>& vote) {
    if (!vote.cast) return;
    const Real w = strength * vote.decay;
    add_outer(sums.tensor, w, vote.v);
    sums.squares += w * w;
    sums.votes += 1;
    sums.strong += vote.decay > Real(kStrongVote) ? Real(1) : Real(0);
}

}  // namespace tvsgs
