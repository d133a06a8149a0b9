// Rows of the stability suite: whitening, votes, eigenpairs.
#pragma once

#include "core/math/eigen.h"
#include "stability/row.h"
#include "tv/vote_math.h"

namespace tvsgs::stability {

/// Eigenpairs of V diag(l) V^T. The residual |A v - l v| and the values are good to rounding, no
/// matter how close the values are; vectors are only as good as their gap.
struct Eigen {
    static constexpr int kIn = 9;

    static void make(Case& make, Vec3d l, double scale) {
        const Mat3<double> V = make.rotation_matrix();
        const auto entry = [&](int i, int j) {
            return scale *
                   (l.x * V[i][0] * V[j][0] + l.y * V[i][1] * V[j][1] + l.z * V[i][2] * V[j][2]);
        };
        make.put(Vec3d{entry(0, 0), entry(0, 1), entry(0, 2)});
        make.put(Vec3d{entry(1, 1), entry(1, 2), entry(2, 2)});
    }
    template <class Real>
    TVSGS_HD static Sym3<Real> matrix(const Real* in) {
        return {in[0], in[1], in[2], in[3], in[4], in[5]};
    }
    static double largest_value(const double* in) { return sym_eigenvalues(matrix(in)).x; }
};

struct EigenValues : Eigen {
    static constexpr int kOut = 6;

    /// The values, and the lengths of the residuals.
    template <class Real>
    TVSGS_HD static void evaluate(const Real* in, Real* out) {
        const SymEigen3<Real> e = sym_eigen(matrix(in));
        for (int j = 0; j < 3; ++j) {
            out[j] = e.values[j];
            // In double: that of the residual itself is not to be measured.
            const Vec3<double> v = vec_cast<double>(column(e.vectors, j));
            const Sym3<double> A{double(in[0]), double(in[1]), double(in[2]),
                                 double(in[3]), double(in[4]), double(in[5])};
            out[3 + j] = Real(norm(A * v - double(e.values[j]) * v));
        }
    }
    static double size(const double* in, const double*) { return largest_value(in); }
    static double bound(const double*, const double*) { return 24 * kRounding; }
};
constexpr const char* kEigenBound = "24 roundings of the largest value";
struct EigenGap : EigenValues {
    static constexpr RowText text{"eigenvalues and residuals", "1 / gap of the upper two",
                                  kEigenBound, ""};
    static constexpr double kFrom = 2, kTo = 1e12;
    static void fill(double stress, Case& make) { Eigen::make(make, {1, 1 - 1 / stress, 0.3}, 1); }
};
struct EigenLowerGap : EigenValues {
    static constexpr RowText text{"eigenvalues and residuals",
                                  "1 / gap of the lower two (collinear points)", kEigenBound, ""};
    static constexpr double kFrom = 2, kTo = 1e12;
    static void fill(double stress, Case& make) { Eigen::make(make, {1, 1 / stress, 0}, 1); }
};
struct EigenScale : EigenValues {
    static constexpr RowText text{"eigenvalues and residuals", "size of the entries", kEigenBound,
                                  "entries are scaled first; below 1e-30 a tensor is no tensor"};
    static constexpr double kFrom = 1e-30, kTo = 1e30;
    static void fill(double stress, Case& make) {
        Eigen::make(make, {1, make.uniform(0.2, 0.9), make.uniform(0, 0.2)}, stress);
    }
};
/// The normal: the axis of the smallest value, as n n^T, which has no sign.
struct EigenNormal : Eigen {
    static constexpr RowText text{"normal (axis of the smallest value)", "1 / gap of the lower two",
                                  "24 roundings / gap",
                                  "gap below 1e-3 of the largest value: the normal is masked out"};
    static constexpr int kOut = 6;
    static constexpr double kFrom = 2, kTo = 1e6;
    static void fill(double stress, Case& make) {
        Eigen::make(make, {1, 0.1 + 1 / stress, 0.1}, 1);
    }
    template <class Real>
    TVSGS_HD static void evaluate(const Real* in, Real* out) {
        const SymEigen3<Real> e = sym_eigen(matrix(in));
        const Vec3<Real> n = column(e.vectors, 2);
        const bool clear = e.values.y - e.values.z >= Real(kMinNormalGap) * e.values.x;
        const Real one = clear ? Real(1) : Real(0);
        out[0] = one * n.x * n.x, out[1] = one * n.x * n.y, out[2] = one * n.x * n.z;
        out[3] = one * n.y * n.y, out[4] = one * n.y * n.z, out[5] = one * n.z * n.z;
    }
    static double size(const double*, const double*) { return 1; }
    static double bound(const double* in, const double*) {
        const Vec3d l = sym_eigenvalues(matrix(in));
        return 24 * kRounding * l.x / std::max(l.y - l.z, 1e-3);
    }
};

/// A voter and a receiver.
struct VotePair {
    static constexpr int kIn = 18;

    struct Drawn {
        Vec3d mean, scales, normal, receiver;
        Quat<double> quat;
        double tau, noise;
    };
    static void put(Case& make, const Drawn& v) {
        make.put(v.mean), make.put(v.quat), make.put(v.scales), make.put(v.normal);
        make.put(v.receiver), make.put(v.tau), make.put(v.noise);
    }
    template <class Real>
    struct Parts {
        VoterRecord<Real> voter;
        Vec3<Real> d, dw;
    };
    template <class Real>
    TVSGS_HD static Parts<Real> parts(const Real* numbers) {
        Feed<Real> in{numbers};
        const Vec3<Real> mean = in.vec3();
        const Quat<Real> quat = in.quat();
        const Vec3<Real> scales = in.vec3(), normal = in.vec3(), receiver = in.vec3();
        const Real tau = in.number(), noise = in.number();
        const VoterRecord<Real> voter =
            voter_record(mean, whitening(quat, scales, WhitenRule{}, noise), tau, normal, Real(1),
                         curvature_factor(false, tau, Real(1)));
        const Vec3<Real> d = receiver - mean;
        return {voter, d, voter.W * d};
    }
    /// A splat as thin as `ratio` says, tangent to its plane, and a receiver that is off the plane
    /// in the whitened space by `angle`, `reach` tau away.
    static Drawn draw(Case& make, double ratio, double size, double reach, double noise_share) {
        Drawn v;
        v.mean = size * make.direction();
        v.quat = make.unit_quat();
        v.scales = {size, size * std::pow(ratio, -make.uniform(0, 1)), size / ratio};
        const Mat3<double> R = rotation(v.quat);
        const Vec3d tilt = make.direction();
        v.normal = normalize(column(R, 2) + 0.02 / ratio * tilt);
        v.noise = noise_share * dot(v.scales, v.scales) / 3;
        v.tau = make.uniform(1, 3);
        const Whitening<double> w = whitening(v.quat, v.scales, WhitenRule{}, v.noise);
        const VoterRecord<double> record =
            voter_record(v.mean, w, v.tau, v.normal, 1.0, curvature_factor(false, v.tau, 1.0));
        // d = W^-1 dw: rows of W are orthonormal in the metric of the splat.
        const double turn = make.uniform(0, 6.28), up = make.uniform(-0.2, 0.2);
        const Vec3d dw =
            reach * v.tau *
            Vec3d{std::cos(up) * std::cos(turn), std::cos(up) * std::sin(turn), std::sin(up)};
        const Mat3<double> cofactors = [&] {
            Mat3<double> C;
            const auto row = [&](int i) {
                return Vec3d{record.W[i][0], record.W[i][1], record.W[i][2]};
            };
            const Vec3d columns[3] = {cross(row(1), row(2)), cross(row(2), row(0)),
                                      cross(row(0), row(1))};
            const double det = dot(row(0), columns[0]);
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < 3; ++j) C[i][j] = columns[j][i] / det;
            return C;
        }();
        v.receiver = v.mean + cofactors * dw;
        return v;
    }
};

/// Where a receiver lies as its voter sees it: length and height above the plane, over tau.
struct Whitened : VotePair {
    static constexpr int kOut = 2;

    template <class Real>
    TVSGS_HD static void evaluate(const Real* numbers, Real* out) {
        const Parts<Real> p = parts(numbers);
        out[0] = norm(p.dw), out[1] = p.dw.z;
    }
    static double size(const double*, const double*) { return 1; }
    static double bound(const double* numbers, const double*) {
        const auto p = parts(numbers);
        double rows = 0;
        for (int i = 0; i < 3; ++i)
            rows += norm(Vec3d{p.voter.W[i][0], p.voter.W[i][1], p.voter.W[i][2]});
        return 6 * kRounding * rows * norm(p.d);
    }
};
constexpr const char* kWhitenedBound =
    "6 roundings x |W| |d|, the condition number sqrt(1 + s_max^2 / noise) of the whitening";
struct WhitenedRatio : Whitened {
    static constexpr RowText text{"whitening: place of a receiver", "ratio of the scales",
                                  kWhitenedBound,
                                  "noise of 1e-4 x the mean trace bounds it at 173"};
    static constexpr double kFrom = 1, kTo = 1e6;
    static void fill(double stress, Case& make) { put(make, draw(make, stress, 0.1, 0.8, 1e-4)); }
};
struct WhitenedScale : Whitened {
    static constexpr RowText text{"whitening: place of a receiver", "absolute scale",
                                  kWhitenedBound, ""};
    static constexpr double kFrom = 1e-6, kTo = 1e6;
    static void fill(double stress, Case& make) { put(make, draw(make, 30, stress, 0.8, 1e-4)); }
};
struct WhitenedGiant : Whitened {
    static constexpr RowText text{
        "whitening: place of a receiver", "largest splat / the rest (global noise)", kWhitenedBound,
        "the noise rounds the others' shapes off: warned of once, names per_splat"};
    static constexpr double kFrom = 1, kTo = 1e4;
    static void fill(double stress, Case& make) {
        // One of 1,000 splats is that much larger.
        put(make, draw(make, 30, 0.1, 0.8, 1e-4 * (1 + stress * stress / 1000)));
    }
};

/// The vote itself: the tensor that a receiver adds up.
struct VoteTensor : VotePair {
    static constexpr int kOut = 6;

    template <class Real>
    TVSGS_HD static void evaluate(const Real* numbers, Real* out) {
        const Parts<Real> p = parts(numbers);
        VoteSums<Real> sums;
        VoteRule rule;
        rule.unit_length = true;
        add_vote(sums, Real(1), plate_vote<ExactMath>(p.voter, p.d, p.dw, rule));
        const Sym3<Real>& T = sums.tensor;
        out[0] = T.xx, out[1] = T.xy, out[2] = T.xz, out[3] = T.yy, out[4] = T.yz, out[5] = T.zz;
    }
    static double size(const double*, const double*) { return 1; }
    static double bound(const double* numbers, const double*) {
        // A unit vector times a decay. The place of the receiver is off by a share of its length:
        // that moves both parts of the exponent, and the vector where its two parts cancel.
        const auto p = parts(numbers);
        VoteRule rule;
        const auto vote = plate_vote<ExactMath>(p.voter, p.d, p.dw, rule);
        if (!vote.cast || vote.decay == 0) return kRounding;
        const double place = Whitened::bound(numbers, nullptr) / norm(p.dw);
        const double parts_of_v = (norm(p.d) + std::abs(p.dw.z) * norm(p.voter.normal_world)) /
                                  norm(vote.v) / norm(Vec3d{p.dw.x, p.dw.y, 0});
        const double l2 = dot(p.dw, p.dw), sine = std::abs(p.dw.z) / std::sqrt(l2);
        const double curvature = 16 * kLn10 * 4 / (kPi * kPi) / l2;
        return 2 * vote.decay * (place + 4 * kRounding) *
               (p.voter.inverse_tau2 * l2 + curvature * sine + parts_of_v);
    }
};
constexpr const char* kVoteBound =
    "twice the decay x the error of the place x (chord + curvature of the exponent + cancellation "
    "between tangent and normal)";
struct VoteRatio : VoteTensor {
    static constexpr RowText text{"a plate's vote", "ratio of the scales", kVoteBound, ""};
    static constexpr double kFrom = 1, kTo = 1e6;
    static void fill(double stress, Case& make) { put(make, draw(make, stress, 0.1, 0.8, 1e-4)); }
};
struct VoteScale : VoteTensor {
    static constexpr RowText text{"a plate's vote", "absolute scale", kVoteBound, ""};
    static constexpr double kFrom = 1e-6, kTo = 1e6;
    static void fill(double stress, Case& make) { put(make, draw(make, 30, stress, 0.8, 1e-4)); }
};
struct VoteCoincident : VoteTensor {
    static constexpr RowText text{"a plate's vote", "tau / distance of the receiver", kVoteBound,
                                  "distance below 1e-6 tau: no vote"};
    static constexpr double kFrom = 0.3, kTo = 1e9;
    static void fill(double stress, Case& make) {
        // In the voter's place: elsewhere floats so near to each other are the same.
        Drawn v = draw(make, 3, 0.1, 1 / stress, 1e-4);
        v.receiver = v.receiver - v.mean, v.mean = {};
        put(make, v);
    }
};
/// Splats on a grid of floats `stress` spacings from the origin: differences are taken first.
struct VoteFar : VoteTensor {
    static constexpr RowText text{"a plate's vote", "distance from the origin / spacing",
                                  kVoteBound, "the scene's origin is moved: see the last rows"};
    static constexpr double kFrom = 1, kTo = 1e5;
    static void fill(double stress, Case& make) {
        Drawn v = draw(make, 30, 1, 0.8, 1e-4);
        const auto on_floats = [](Vec3d p) { return vec_cast<double>(vec_cast<float>(p)); };
        const Vec3d d = v.receiver - v.mean;
        v.mean = on_floats(v.mean + stress * make.direction());
        v.receiver = on_floats(v.mean + d);
        put(make, v);
    }
};

}  // namespace tvsgs::stability
