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

/// The current splats in the slots of the last search, and the fixed voters after them.
struct Slots {
    Span<const TreePoint> points;
    SplatSpans splats;
    FixedVoterSpans fixed;

    TVSGS_HD int usable() const { return points.size(); }
    TVSGS_HD int size() const { return points.size() + fixed.size(); }
    TVSGS_HD int splat(int slot) const { return static_cast<int>(points[slot].index); }
    /// Splats change between searches: one may have left the finite numbers.
    TVSGS_HD bool usable(int voter) const {
        return voter >= usable() || splats.usable(splat(voter));
    }
    TVSGS_HD Vec3f mean(int voter) const {
        return voter < usable() ? splats.means[splat(voter)] : fixed.means[voter - usable()];
    }
    template <class Real>
    TVSGS_HD Whitening<Real> whitening(int voter,
                                       const WhitenRule& rule,
                                       const double* noise) const {
        return voter < usable() ? splats.whitening<Real>(splat(voter), rule, *noise)
                                : fixed.whitening<Real>(voter - usable());
    }
};

/// In slot order what is near in space is near in memory. One 16-byte load each.
struct alignas(16) SlotVector {
    Vec3f v;
};
struct MeanBody {
    Slots slots;
    Span<SlotVector> means;
    TVSGS_HD void operator()(int slot) const { means[slot].v = slots.mean(slot); }
};

#if defined(__CUDACC__)
template <class Real>
struct RecordWords {
    static constexpr int kCount = sizeof(VoterRecord<Real>) / sizeof(uint4);
    uint4 w[kCount];
};
#endif

/// Whole records in the widest loads and stores there are: entry by entry they cost four times the
/// traffic.
template <class Real>
TVSGS_HD VoterRecord<Real> load(const VoterRecord<Real>& from) {
#if defined(__CUDA_ARCH__)
    RecordWords<Real> words;
#pragma unroll
    for (int i = 0; i < RecordWords<Real>::kCount; ++i)
        words.w[i] = __ldg(reinterpret_cast<const uint4*>(&from) + i);
    return __builtin_bit_cast(VoterRecord<Real>, words);
#else
    return from;
#endif
}
template <class Real>
TVSGS_HD void store(const VoterRecord<Real>& record, VoterRecord<Real>& to) {
#if defined(__CUDA_ARCH__)
    const auto words = __builtin_bit_cast(RecordWords<Real>, record);
#pragma unroll
    for (int i = 0; i < RecordWords<Real>::kCount; ++i)
        reinterpret_cast<uint4*>(&to)[i] = words.w[i];
#else
    to = record;
#endif
}

/// The part of the records that TauBody reads: W, and inverse_tau2 = 0 for who cannot vote.
template <class Real>
struct WhiteningBody {
    Slots slots;
    WhitenRule rule;
    const double* noise;
    Span<VoterRecord<Real>> records;

    TVSGS_HD void operator()(int voter) const {
        VoterRecord<Real> record{};
        if (slots.usable(voter)) {
            record.mean = vec_cast<Real>(slots.mean(voter));
            record.W = whitened_from_world(slots.whitening<Real>(voter, rule, noise));
            record.inverse_tau2 = 1;
        }
        store(record, records[voter]);
    }
};

/// Scales of voting, from the current splats.
template <class Real>
struct TauBody {
    static constexpr int kMinBlocks = sizeof(Real) == sizeof(float) ? 3 : 1;

    float tau_per_median;
    int k;
    Span<const std::uint32_t> receivers;
    Span<const SlotVector> means;
    Span<const VoterRecord<Real>> records;
    Span<float> tau;

    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int voter, void* scratch) const {
        const VoterRecord<Real> record = load(records[voter]);
        float scale = 0;
        if (can_vote(record)) {  // the same answer in all lanes
            const std::uint32_t* list = receivers.data + std::size_t(voter) * k;
            scale = tau_per_median * warp.median(k, static_cast<float*>(scratch), [&](int r) {
                const Vec3<Real> at = vec_cast<Real>(means[list[r]].v);
                return static_cast<float>(norm(record.W * (at - record.mean)));
            });
        }
        if (warp.lane() == 0) tau[voter] = scale;
    }
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

/// How voter i votes this round: with the plate of the tensor it has, else (strength 1, normal 0)
/// as a ball.
struct OrientationBody {
    Slots slots;
    bool literal;
    const double* saliency_sum;  // and the number of terms after it
    Span<const Vec3f> eigenvalues, normals;
    Span<const std::uint8_t> flags;
    Span<Vec3f> voter_normals;
    Span<float> voter_strengths;

    TVSGS_HD void operator()(int voter) const {
        if (voter >= slots.usable()) {
            voter_normals[voter] = slots.fixed.normals[voter - slots.usable()];
            voter_strengths[voter] = slots.fixed.weights[voter - slots.usable()];
            return;
        }
        const int i = slots.splat(voter);
        const bool has_tensor = (flags[i] & kHasTensor) != 0;
        voter_normals[voter] = has_tensor ? normals[i] : Vec3f{};
        voter_strengths[voter] = 1;
        if (!has_tensor) return;
        const Vec3f l = eigenvalues[i];
        const double mean =
            literal ? saliency_sum[0] / (saliency_sum[1] > 1 ? saliency_sum[1] : 1) : double(l.x);
        const double strength = mean > 0 ? (double(l.y) - double(l.z)) / mean : 0;
        voter_strengths[voter] = strength > 0 ? static_cast<float>(strength) : 0.0f;
    }
};

/// Computed in double for both kinds of record: a thin splat magnifies the rounding of its axes.
template <class Real>
struct RecordBody {
    Slots slots;
    WhitenRule rule;
    const double* noise;
    Span<const float> tau;
    Span<const Vec3f> voter_normals;
    Span<const float> voter_strengths;
    Span<VoterRecord<Real>> records;

    TVSGS_HD void operator()(int voter) const {
        VoterRecord<Real> record{};
        if (slots.usable(voter))
            record = record_cast<Real>(voter_record<double>(
                vec_cast<double>(slots.mean(voter)), slots.whitening<double>(voter, rule, noise),
                tau[voter], vec_cast<double>(voter_normals[voter]), voter_strengths[voter]));
        store(record, records[voter]);
    }
};

/// Who receives from whom.
template <class Real>
struct Ballot {
    Span<const VoterRecord<Real>> records;
    Span<const SlotVector> means;
    Span<const std::int64_t> begin;
    Span<const std::uint32_t> voters;
    VoteRule rule;

    /// action(voter's record) for each of this lane's share of a slot's voters.
    template <class Warp, class Action>
    TVSGS_HD void for_each_voter(const Warp& warp, int slot, const Action& action) const {
        const std::int64_t end = begin[slot + 1];
        for (std::int64_t e = begin[slot] + warp.lane(); e < end; e += Warp::kLanes)
            action(load(records[voters[e]]));
    }
};

/// One receiver's sums of a round at the centres, of ball votes or of plate votes.
template <class Real>
struct CentreRoundBody {
    static constexpr int kMinBlocks = sizeof(Real) == sizeof(float) ? 3 : 1;

    Ballot<Real> ballot;
    bool ball_round;  // only splats without a tensor cast and receive
    Slots slots;
    Span<const std::uint8_t> flags;
    Span<Sym3f> sums;  // by slot, as the next two
    Span<float> strengths, strong_votes;

    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int slot, void*) const {
        if (ball_round && (flags[slots.splat(slot)] & kHasTensor) != 0) return;
        const Vec3<Real> mean = vec_cast<Real>(ballot.means[slot].v);
        VoteSums<Real> s;
        ballot.for_each_voter(warp, slot, [&](const VoterRecord<Real>& voter) {
            if (!can_vote(voter) || is_ball(voter) != ball_round) return;
            const Vec3<Real> d = mean - voter.mean, dw = voter.W * d;
            add_vote(s, voter.strength,
                     ball_round ? ball_vote<ExactMath>(voter, d, dw, ballot.rule)
                                : plate_vote<ExactMath>(voter, d, dw, ballot.rule));
        });
        Sym3<Real>& T = s.tensor;
        T.xx = warp.sum(T.xx), T.xy = warp.sum(T.xy), T.xz = warp.sum(T.xz);
        T.yy = warp.sum(T.yy), T.yz = warp.sum(T.yz), T.zz = warp.sum(T.zz);
        s.squares = warp.sum(s.squares), s.votes = warp.sum(s.votes), s.strong = warp.sum(s.strong);
        if (warp.lane() != 0) return;
        sums[slot] = {float(T.xx), float(T.xy), float(T.xz), float(T.yy), float(T.yz), float(T.zz)};
        strengths[slot] =
            static_cast<float>(std::sqrt(s.squares / (s.votes > 1 ? s.votes : Real(1))));
        strong_votes[slot] = static_cast<float>(s.strong);
    }
};

/// For reports: votes cast by plates at the centres, and those among them that are zero.
template <class Real>
struct VoteCountBody {
    Ballot<Real> ballot;
    Span<float> votes, culled;  // by slot

    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int slot, void*) const {
        const Vec3<Real> mean = vec_cast<Real>(ballot.means[slot].v);
        float cast = 0, zero = 0;
        ballot.for_each_voter(warp, slot, [&](const VoterRecord<Real>& voter) {
            if (!can_vote(voter) || is_ball(voter)) return;
            const Vec3<Real> d = mean - voter.mean;
            const Vote<Real> vote = plate_vote<FastMath>(voter, d, voter.W * d, ballot.rule);
            cast += vote.cast ? 1.0f : 0.0f;
            zero += vote.cast && vote.decay == 0 ? 1.0f : 0.0f;
        });
        cast = warp.sum(cast), zero = warp.sum(zero);
        if (warp.lane() == 0) votes[slot] = cast, culled[slot] = zero;
    }
};
struct ValueTerm {
    Span<const float> values;
    TVSGS_HD double operator()(int i) const { return values[i]; }
};
struct SilentTerm {
    Span<const float> tau;
    TVSGS_HD double operator()(int i) const { return inverse_square_or_zero(tau[i]) > 0 ? 0 : 1; }
};

inline constexpr std::uint8_t kValidNow =
    128;  // this round reached the splat; cleared at the end of the event

/// Takes over valid sums as the new tensors. Others keep what they had, and are masked out of both
/// losses. In double on both devices: a flat voter magnifies the error of its normal a hundredfold
/// in the next round.
struct EigenBody {
    bool ball_round;
    Slots slots;
    Span<const Sym3f> sums;
    Span<Sym3f> tensors;
    Span<Vec3f> eigenvalues, normals;
    Span<std::uint8_t> flags;
    Span<SlotVector> slot_normals;  // of the tensor there is now; zero for none

    TVSGS_HD void operator()(int slot) const {
        const int i = slots.splat(slot);
        if (ball_round && (flags[i] & kHasTensor) != 0) return;
        const Sym3f T = sums[slot];
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
        slot_normals[slot].v = (flag & kHasTensor) != 0 ? normals[i] : Vec3f{};
    }
};

/// Root mean square angle between a splat's normal and its receivers'; infinite where the tensor is
/// not valid, so that both statistics sort such splats to the end.
struct VariabilityBody {
    int k;
    Slots slots;
    Span<const std::uint32_t> receivers;
    Span<const SlotVector> slot_normals;
    Span<const std::uint8_t> flags;
    Span<float> variability, strengths;

    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int slot, void*) const {
        constexpr float kInvalid = std::numeric_limits<float>::infinity();
        if ((flags[slots.splat(slot)] & kValidNow) == 0) {
            if (warp.lane() == 0) variability[slot] = kInvalid, strengths[slot] = kInvalid;
            return;
        }
        const Vec3f n = slot_normals[slot].v;
        float sum = 0, count = 0;
        for (int r = warp.lane(); r < k; r += Warp::kLanes) {
            const Vec3f m = slot_normals[receivers[std::size_t(slot) * k + r]].v;
            // The angle from sine and cosine: arccos alone loses the small ones in float.
            const float angle = angle_of(norm(cross(n, m)), std::abs(dot(n, m)));
            const bool counts = dot(m, m) > 0;
            sum += counts ? angle * angle : 0;
            count += counts ? 1.0f : 0.0f;
        }
        sum = warp.sum(sum), count = warp.sum(count);
        if (warp.lane() == 0) variability[slot] = std::sqrt(sum / (count > 1 ? count : 1));
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
    Slots slots;
    float min_votes;
    const double* valid_count;
    Span<const float> variability, strengths, sorted_variability, sorted_strengths, strong_votes;
    Span<std::uint8_t> flags, left_out;  // left_out: by slot

    TVSGS_HD void operator()(int slot) const {
        const int i = slots.splat(slot);
        const std::uint8_t flag = flags[i];
        left_out[slot] = 0;
        if ((flag & kValidNow) == 0) return;
        left_out[slot] = variability[slot] > percentile95(sorted_variability, *valid_count) &&
                                 strengths[slot] > percentile95(sorted_strengths, *valid_count)
                             ? 1
                             : 0;
        const bool position_valid =
            (flag & kNormalValid) != 0 && left_out[slot] == 0 && strong_votes[slot] >= min_votes;
        if (position_valid) flags[i] = flag | kPositionValid;
    }
};

/// Before an event: nothing is valid yet, and the target of a splat that takes no part is its
/// centre.
struct BeginBody {
    Span<const Vec3f> means;
    Span<std::uint8_t> flags;
    Span<Vec3f> targets;
    TVSGS_HD void operator()(int i) const {
        flags[i] &= kHasTensor;
        targets[i] = means[i];
    }
};

/// Position loss targets: the centre or the virtual receiver of largest surface saliency.
template <class Real, bool kUnitVotes>
struct VirtualBody {
    static constexpr int kMinBlocks = sizeof(Real) == sizeof(float) ? 3 : 1;

    Ballot<Real> ballot;
    bool centre_known;  // the centre's tensor is of the same voters: no need to vote there again
    float range;        // reach, in largest scales
    Slots slots;
    Span<const Vec3f> eigenvalues, normals;
    Span<Vec3f> targets;
    Span<std::uint8_t> flags;

    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int slot, void*) const {
        const int i = slots.splat(slot);
        const std::uint8_t flag = flags[i];
        warp.sync();  // all lanes have read the flag before it changes
        if (warp.lane() == 0) flags[i] = flag & (kHasTensor | kNormalValid | kPositionValid);
        if ((flag & kValidNow) == 0) return;
        const Vec3<Real> mean = vec_cast<Real>(ballot.means[slot].v);
        const Vec3f s = slots.splats.scales<float>(i);
        const float largest = s.x > s.y ? (s.x > s.z ? s.x : s.z) : (s.y > s.z ? s.y : s.z);
        const Vec3<Real> step = Real(range) * Real(largest) / 5 * vec_cast<Real>(normals[i]);
        const Vec3f l = eigenvalues[i];
        Best best{centre_known ? Real(l.y) - Real(l.z) : Real(-1), 0};
        if constexpr (Warp::kLanes == 1) {
            Real T[6][12] = {};  // 11 of them; vectors like 12
            add_votes<0>(warp, slot, mean, step, T);
            for (int j = 0; j < 11; ++j)
                keep_best(surface_saliency({T[0][j], T[1][j], T[2][j], T[3][j], T[4][j], T[5][j]}),
                          position(j), best);
        } else {
            Sym3<Real> mine{};  // lane j decomposes the tensor at position(j)
            if (!centre_known) collect<0, 1>(warp, slot, mean, step, mine);
            collect<1, kGroup>(warp, slot, mean, step, mine);
            if constexpr (kGroup < 10)
                collect<1 + kGroup, 10 - kGroup>(warp, slot, mean, step, mine);
            const Real saliency = surface_saliency(mine);
            for (int j = centre_known ? 1 : 0; j < 11; ++j)
                keep_best(warp.from_lane(saliency, j), position(j), best);
        }
        if (warp.lane() == 0 && best.m != 0)
            targets[i] = vec_cast<float>(mean + Real(best.m) * step);
    }

private:
    static constexpr int kGroup = 5;  // positions summed at a time: 30 sums in registers
    struct Best {
        Real saliency;
        int m;
    };
    /// 0, -1, 1, -2, ...: with a strict comparison a tie keeps the centre, then the nearer, then
    /// the negative.
    TVSGS_HD static constexpr int position(int j) { return j % 2 == 1 ? -(j + 1) / 2 : j / 2; }

    /// Adds this lane's share of the votes at position(kFirst), ... to the six entries of tensors.
    template <int kFirst, int kCount, class Warp>
    TVSGS_HD void add_votes(
        const Warp& warp, int slot, Vec3<Real> mean, Vec3<Real> step, Real (&T)[6][kCount]) const {
        VoteRule rule = ballot.rule;
        rule.unit_length = kUnitVotes;  // a constant
        ballot.for_each_voter(warp, slot, [&](const VoterRecord<Real>& voter) {
            if (!can_vote(voter) || is_ball(voter)) return;
            const Vec3<Real> d = mean - voter.mean, dw = voter.W * d, step_w = voter.W * step;
            for_constants<kCount>([&](int j) {
                const Real m = static_cast<Real>(position(kFirst + j));
                const Vote<Real> vote =
                    plate_vote<FastMath>(voter, d + m * step, dw + m * step_w, rule);
                const Vec3<Real> v = vote.v,
                                 wv = voter.strength * vote.decay * vote.inverse_length2 * v;
                T[0][j] += wv.x * v.x, T[1][j] += wv.x * v.y, T[2][j] += wv.x * v.z;
                T[3][j] += wv.y * v.y, T[4][j] += wv.y * v.z, T[5][j] += wv.z * v.z;
            });
        });
    }

    /// Lane kFirst + j gets tensor j, summed over the lanes.
    template <int kFirst, int kCount, class Warp>
    TVSGS_HD void collect(
        const Warp& warp, int slot, Vec3<Real> mean, Vec3<Real> step, Sym3<Real>& mine) const {
        Real T[6][kCount] = {};
        add_votes<kFirst>(warp, slot, mean, step, T);
        const int j = warp.lane() - kFirst;
        const bool is_mine = j >= 0 && j < kCount;
        Real entries[6] = {};
        if constexpr (sizeof(Real) == sizeof(float)) {
            constexpr int kEntries = 5;  // tensors that fit one exchange
            for (int first = 0; first < kCount; first += kEntries) {
                Real values[32] = {};
                for (int c = 0; c < 6; ++c)
                    for (int t = first; t < first + kEntries && t < kCount; ++t)
                        values[6 * (t - first) + c] = T[c][t];
                const Real sum = warp.sums_to_lanes(values);
                for (int c = 0; c < 6; ++c) {
                    const Real entry = warp.from_lane(sum, (6 * (j - first) + c) & 31);
                    if (j >= first && j < first + kEntries) entries[c] = entry;
                }
            }
        } else {
            for (int c = 0; c < 6; ++c)
                for (int t = 0; t < kCount; ++t) {
                    const Real sum = warp.sum(T[c][t]);
                    if (t == j) entries[c] = sum;
                }
        }
        if (is_mine)
            mine = {entries[0], entries[1], entries[2], entries[3], entries[4], entries[5]};
    }

    TVSGS_HD static Real surface_saliency(const Sym3<Real>& T) {
        const Vec3<Real> values = sym_eigenvalues<FastMath>(T);
        return values.y - values.z;
    }
    TVSGS_HD static void keep_best(Real saliency, int m, Best& best) {
        if (saliency > best.saliency) best = {saliency, m};  // NaN never wins
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
