// One voting event, element by element; both twins run these.  [tensor voting specification,
// section 4]
#pragma once

#include "core/eigen.h"
#include "core/parallel.h"
#include "tv/splats.h"
#include "tv/voting.h"
#include "tv/warp.h"

namespace tvsgs::detail {

struct NoiseTerm {  // trace of a usable splat's covariance, thin scales raised
    SplatSpans splats;
    float flatness_limit;
    TVSGS_HD double operator()(int i) const {
        if (!splats.usable(i)) return 0;
        const Vec3<double> s = limit_flatness(splats.scales<double>(i), double(flatness_limit));
        return dot(s, s);
    }
};

struct UsableSplatTerm {
    SplatSpans splats;
    TVSGS_HD double operator()(int i) const { return splats.usable(i) ? 1 : 0; }
};

struct NoiseBody {
    const double* count;
    double* noise;
    TVSGS_HD void operator()(int) const {
        *noise = kWhitenNoise * *noise / (*count > 1 ? *count : 1);
    }
};

/// The part of voter i's record that does not depend on its tensor; tau from the current splats.
template <class Real>
struct RecordBody {
    SplatSpans splats;
    WhitenRule rule;
    const double* noise;
    Real tau_per_median;
    int k;
    Span<const std::uint32_t> receivers;
    Span<VoterRecord<Real>> records;
    Span<float> tau;  // may be empty

    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int i, void* scratch) const {
        auto* distances = static_cast<Real*>(scratch);
        VoterRecord<Real> record{};
        record.mean = vec_cast<Real>(splats.means[i]);
        Real scale = 0;
        if (splats.usable(i)) {  // the same answer in all lanes
            record.W = whitened_from_world(splats.whitening<Real>(i, rule, *noise));
            for (int r = warp.lane(); r < k; r += Warp::kLanes) {
                const std::uint32_t j = receivers[std::size_t(i) * k + r];
                // A splat may have become usable since the search, its list undefined.
                const Vec3<Real> mean = vec_cast<Real>(splats.means[j < records.count ? j : 0]);
                const Real distance = norm(record.W * (mean - record.mean));
                distances[r] =
                    distance >= 0 ? distance : Real(kFar);  // not NaN: it has to be sorted
            }
            scale = tau_per_median * median(warp, distances, k);
            record.inverse_tau2 = inverse_square_or_zero(scale);
        }
        if (warp.lane() != 0) return;
        records[i] = record;
        if (!tau.empty()) tau[i] = static_cast<float>(scale);
    }

private:
    static constexpr float kFar = std::numeric_limits<float>::infinity();
};

/// Saliency of the splats that have a tensor, and their number, for the common rescale of literal
/// strengths.
struct SaliencyTerm {
    Span<const Vec3f> eigenvalues;
    Span<const std::uint8_t> flags;
    TVSGS_HD double operator()(int i) const {
        return (flags[i] & kHasTensor) != 0 ? double(eigenvalues[i].y) - double(eigenvalues[i].z)
                                            : 0;
    }
};
struct FlagTerm {
    std::uint8_t flag;
    Span<const std::uint8_t> flags;
    TVSGS_HD double operator()(int i) const { return (flags[i] & flag) != 0 ? 1 : 0; }
};

/// How splat i votes this round: with the plate of the tensor it has, else (strength 1, normal 0)
/// as a ball.
struct StrengthBody {
    bool literal;
    const double* saliency_sum;  // and the number of terms after it
    Span<const Vec3f> eigenvalues, normals;
    Span<const std::uint8_t> flags;
    Span<Vec3f> voter_normals;
    Span<float> voter_strengths;

    TVSGS_HD void operator()(int i) const {
        const bool has_tensor = (flags[i] & kHasTensor) != 0;
        voter_normals[i] = has_tensor ? normals[i] : Vec3f{};
        if (!has_tensor) {
            voter_strengths[i] = 1;
            return;
        }
        const Vec3f l = eigenvalues[i];
        const double mean =
            literal ? saliency_sum[0] / (saliency_sum[1] > 1 ? saliency_sum[1] : 1) : double(l.x);
        const double strength = mean > 0 ? (double(l.y) - double(l.z)) / mean : 0;
        voter_strengths[i] = strength > 0 ? static_cast<float>(strength) : 0.0f;
    }
};

template <class Real>
struct OrientBody {
    SplatSpans splats;
    WhitenRule rule;
    const double* noise;
    Span<const Vec3f> voter_normals;
    Span<const float> voter_strengths;
    Span<VoterRecord<Real>> records;

    TVSGS_HD void operator()(int i) const {
        VoterRecord<Real>& record = records[i];
        if (!can_vote(record)) return;
        set_orientation(record, splats.whitening<Real>(i, rule, *noise),
                        vec_cast<Real>(voter_normals[i]), Real(voter_strengths[i]));
        // What is not finite cannot vote: a single such vote would spoil its receivers' sums.
        Real finite =
            (dot(record.normal, record.normal) + dot(record.normal_world, record.normal_world)) * 0;
        for (int row = 0; row < 3; ++row)
            for (int c = 0; c < 3; ++c) finite += record.W[row][c] * 0;
        if (!(finite == 0)) record.inverse_tau2 = 0;
    }
};

/// Who receives from whom.
template <class Real>
struct Ballot {
    Span<const VoterRecord<Real>> records;
    Span<const Vec3f> means;
    Span<const std::int64_t> begin;
    Span<const std::uint32_t> voters;
    VoteRule rule;
};

/// One receiver's sums of a round at the centres, of ball votes or of plate votes.
template <class Real>
struct CentreRoundBody {
    Ballot<Real> ballot;
    bool ball_round;  // only splats without a tensor cast and receive
    Span<const std::uint8_t> flags;
    Span<Sym3f> sums;
    Span<float> strengths, strong_votes;

    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int i, void*) const {
        if (ball_round && (flags[i] & kHasTensor) != 0) return;
        const Vec3<Real> mean = vec_cast<Real>(ballot.means[i]);
        VoteSums<Real> s;
        for (std::int64_t e = ballot.begin[i] + warp.lane(); e < ballot.begin[i + 1];
             e += Warp::kLanes) {
            const VoterRecord<Real>& voter = ballot.records[ballot.voters[e]];
            if (!can_vote(voter) || is_ball(voter) != ball_round) continue;
            const Vec3<Real> d = mean - voter.mean, dw = voter.W * d;
            add_vote(s, voter.strength,
                     ball_round ? ball_vote(voter, d, dw, ballot.rule)
                                : plate_vote(voter, d, dw, ballot.rule));
        }
        Sym3<Real>& T = s.tensor;
        T.xx = warp.sum(T.xx), T.xy = warp.sum(T.xy), T.xz = warp.sum(T.xz);
        T.yy = warp.sum(T.yy), T.yz = warp.sum(T.yz), T.zz = warp.sum(T.zz);
        s.squares = warp.sum(s.squares), s.votes = warp.sum(s.votes), s.strong = warp.sum(s.strong);
        if (warp.lane() != 0) return;
        sums[i] = {float(T.xx), float(T.xy), float(T.xz), float(T.yy), float(T.yz), float(T.zz)};
        strengths[i] = static_cast<float>(std::sqrt(s.squares / (s.votes > 1 ? s.votes : Real(1))));
        strong_votes[i] = static_cast<float>(s.strong);
    }
};

inline constexpr std::uint8_t kValidNow =
    128;  // this round reached the splat; cleared at the end of the event

/// Takes over valid sums as the new tensors. Others keep what they had, and are masked out of both
/// losses. In double on both devices: a flat voter magnifies the error of its normal a hundredfold
/// in the next round.
struct EigenBody {
    bool ball_round;
    Span<const Sym3f> sums;
    Span<Sym3f> tensors;
    Span<Vec3f> eigenvalues, normals;
    Span<std::uint8_t> flags;

    TVSGS_HD void operator()(int i) const {
        if (ball_round && (flags[i] & kHasTensor) != 0) return;
        const Sym3f T = sums[i];
        const SymEigen3<double> e = sym_eigen(Sym3<double>{T.xx, T.xy, T.xz, T.yy, T.yz, T.zz});
        const double finite = (e.values.x + e.values.y + e.values.z) * 0;
        std::uint8_t flag = flags[i] & kHasTensor;
        if (finite == 0 && e.values.x >= kMinEigenvalue) {
            flag = kHasTensor;
            if ((e.values.y - e.values.z) / e.values.x >= kMinNormalGap) flag |= kNormalValid;
            tensors[i] = T;
            eigenvalues[i] = vec_cast<float>(e.values);
            normals[i] = vec_cast<float>(column(e.vectors, 2));
            flag |= kValidNow;
        }
        flags[i] = flag;
    }
};

/// Root mean square angle between a splat's normal and its receivers'; infinite where the tensor is
/// not valid, so that both statistics sort such splats to the end.
struct VariabilityBody {
    int k;
    Span<const std::uint32_t> receivers;
    Span<const Vec3f> normals;
    Span<const std::uint8_t> flags;
    Span<float> variability, strengths;

    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int i, void*) const {
        constexpr float kInvalid = std::numeric_limits<float>::infinity();
        if ((flags[i] & kValidNow) == 0) {
            if (warp.lane() == 0) variability[i] = kInvalid, strengths[i] = kInvalid;
            return;
        }
        const Vec3f n = normals[i];
        float sum = 0, count = 0;
        for (int r = warp.lane(); r < k; r += Warp::kLanes) {
            const std::uint32_t j = receivers[std::size_t(i) * k + r];
            if (j >= flags.count || (flags[j] & kHasTensor) == 0) continue;
            // The angle from sine and cosine: arccos alone loses the small ones in float.
            const float angle =
                std::atan2(norm(cross(n, normals[j])), std::abs(dot(n, normals[j])));
            sum += angle * angle;
            count += 1;
        }
        sum = warp.sum(sum), count = warp.sum(count);
        if (warp.lane() == 0) variability[i] = std::sqrt(sum / (count > 1 ? count : 1));
    }
};

/// Linear interpolation between the order statistics of the first `count` sorted values.
TVSGS_HD inline float percentile95(Span<const float> sorted, double count) {
    const double rank = 0.95 * (count - 1);
    const auto low = static_cast<int>(rank), high = low + 1 < count ? low + 1 : low;
    return static_cast<float>(sorted[low] +
                              (double(sorted[high]) - double(sorted[low])) * (rank - low));
}

/// Who takes part in the position loss.
struct MaskBody {
    float min_votes;
    const double* valid_count;
    Span<const float> variability, strengths, sorted_variability, sorted_strengths, strong_votes;
    Span<std::uint8_t> flags, left_out;

    TVSGS_HD void operator()(int i) const {
        const std::uint8_t flag = flags[i];
        left_out[i] = 0;
        if ((flag & kValidNow) == 0) return;
        left_out[i] = variability[i] > percentile95(sorted_variability, *valid_count) &&
                              strengths[i] > percentile95(sorted_strengths, *valid_count)
                          ? 1
                          : 0;
        const bool position_valid =
            (flag & kNormalValid) != 0 && left_out[i] == 0 && strong_votes[i] >= min_votes;
        if (position_valid) flags[i] = flag | kPositionValid;
    }
};

/// Position loss targets: the centre or the virtual receiver of largest surface saliency.
template <class Real>
struct VirtualBody {
    Ballot<Real> ballot;
    float range;  // reach, in largest scales
    Span<const Vec3f> log_scales, normals;
    Span<Vec3f> targets;
    Span<std::uint8_t> flags;

    static constexpr int kGroup = 6;  // positions summed at a time: 36 sums in registers

    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int i, void*) const {
        const bool valid = (flags[i] & kValidNow) != 0;
        const Vec3<Real> mean = vec_cast<Real>(ballot.means[i]);
        const Vec3<Real> s = exp(vec_cast<Real>(log_scales[i]));
        const Real largest = s.x > s.y ? (s.x > s.z ? s.x : s.z) : (s.y > s.z ? s.y : s.z);
        const Vec3<Real> step = Real(range) * largest / 5 * vec_cast<Real>(normals[i]);
        Real best = -1;
        int best_m = 0;
        if (valid) {
            // 0, -1, 1, -2, ...: with a strict comparison a tie keeps the centre, then the nearer,
            // then the negative.
            group<0>(warp, i, mean, step, best, best_m);
            group<kGroup>(warp, i, mean, step, best, best_m);
        }
        warp.sync();
        if (warp.lane() != 0) return;
        targets[i] = best_m == 0 ? ballot.means[i] : vec_cast<float>(mean + Real(best_m) * step);
        flags[i] &= kHasTensor | kNormalValid | kPositionValid;
    }

private:
    TVSGS_HD static constexpr int position(int j) { return j % 2 == 1 ? -(j + 1) / 2 : j / 2; }

    template <int kFirst, class Warp>
    TVSGS_HD void group(
        const Warp& warp, int i, Vec3<Real> mean, Vec3<Real> step, Real& best, int& best_m) const {
        constexpr int kCount = kFirst + kGroup > 11 ? 11 - kFirst : kGroup;
        Sym3<Real> T[kCount]{};
        for (std::int64_t e = ballot.begin[i] + warp.lane(); e < ballot.begin[i + 1];
             e += Warp::kLanes) {
            const VoterRecord<Real>& voter = ballot.records[ballot.voters[e]];
            if (!can_vote(voter) || is_ball(voter)) continue;
            const Vec3<Real> d = mean - voter.mean, dw = voter.W * d, step_w = voter.W * step;
            unrolled<kCount>([&](auto j) {
                const Real m = position(kFirst + j);
                const Vote<Real> vote =
                    plate_vote(voter, d + m * step, dw + m * step_w, ballot.rule);
                if (vote.cast) add_outer(T[j], voter.strength * vote.decay, vote.v);
            });
        }
        Sym3<Real> mine{};  // each lane decomposes one of the tensors
        unrolled<kCount>([&](auto j) {
            const Sym3<Real> sum{warp.sum(T[j].xx), warp.sum(T[j].xy), warp.sum(T[j].xz),
                                 warp.sum(T[j].yy), warp.sum(T[j].yz), warp.sum(T[j].zz)};
            if constexpr (Warp::kLanes == 1)
                keep_best(surface_saliency(sum), position(kFirst + j), best, best_m);
            else if (warp.lane() == j)
                mine = sum;
        });
        if constexpr (Warp::kLanes > 1) {
            const Real saliency = surface_saliency(mine);
            for (int j = 0; j < kCount; ++j)
                keep_best(warp.from_lane(saliency, j), position(kFirst + j), best, best_m);
        }
    }

    TVSGS_HD static Real surface_saliency(const Sym3<Real>& T) {
        const Vec3<Real> values = sym_eigenvalues(T);
        return values.y - values.z;
    }
    TVSGS_HD static void keep_best(Real saliency, int m, Real& best, int& best_m) {
        if (saliency > best) best = saliency, best_m = m;  // NaN never wins
    }
};

/// Entries of new splats from their parents; a negative parent is none.
template <class T>
struct InheritBody {
    Span<const int> parents;
    Span<const T> from;
    Span<T> to;
    TVSGS_HD void operator()(int i) const { to[i] = parents[i] < 0 ? T{} : from[parents[i]]; }
};

/// Targets count again after the next event, which due() orders at once: children may have moved.
struct ClearPositionBody {
    Span<std::uint8_t> flags;
    TVSGS_HD void operator()(int i) const { flags[i] &= kHasTensor | kNormalValid; }
};

}  // namespace tvsgs::detail
