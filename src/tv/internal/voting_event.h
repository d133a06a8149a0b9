// One voting event, step by step, for both devices. The lists must fit the splats.
// [docs/method/voting.md#one-event]
#pragma once

#include <algorithm>
#include <cmath>

#include "tv/internal/voting_bodies.h"
#include "tv/internal/voting_state.h"

namespace tvsgs::detail {

inline WhitenRule whiten_rule(const TvOptions& o, float flatness_limit) {
    return {o.whiten, o.whiten_noise_mode == NoiseMode::per_splat, flatness_limit};
}

inline VoteRule vote_rule(const TvOptions& o) {
    const double sine = std::sin(o.max_vote_angle_deg * kPi / 180);
    return {o.vote_map == VoteMap::unit, o.max_vote_angle_deg < 90 ? float(sine * sine) : 2.0f};
}

/// A whitening rule with the scales of voting that belong to it.
template <class Device>
struct Whitened {
    WhitenRule rule;
    const double* noise;  // on the device
    Buffer<float, Device>& tau;
};

/// Real: precision of the votes. Lists: FullLists or CompactLists.
template <class Real, class Lists, class Device>
struct VotingEvent {
    const TvOptions& options;
    const Lists& lists;
    const SplatSpans& splats;
    VotingState<Device>& s;
    TensorField<Device>& field;

    const Ranks ranks = s.ranks(splats);
    const int k = s.neighbours.k, usable = s.neighbours.usable, voters = s.neighbours.voters_count;
    const double tau_per_median =
        options.scale_rule == ScaleRule::median ? 1 : 1 / std::sqrt(kLn10);
    Buffer<VoterRecord<Real>, Device>& records = s.template records_of<Real>();
    const Whitened<Device> at_centres{whiten_rule(options, options.flatness_limit),
                                      s.totals.data() + kNoise, s.tau};

    /// Without `targets` no splat takes part in the position loss.
    void run(bool targets) {
        begin();
        if (!s.all_have_tensors) vote_at_centres(true);  // of splats without a tensor
        plate_round();
        if (!targets) return keep_flags(kHasTensor | kNormalValid);
        mask_positions();
        if (options.targets == Targets::anchor)
            return keep_flags(kHasTensor | kNormalValid | kPositionValid);
        vote_at_virtual_receivers();
    }

    void keep_flags(int kept) {
        parallel_for(Device{}, splats.size(), KeepFlagsBody{kept, field.flags.span()});
    }

    /// Computes the centres and scales of voting, which all rounds share.
    void begin() {
        records.resize(voters), s.tau.resize(voters);
        s.voter_strengths.resize(voters), s.voter_normals.resize(voters);
        s.means.resize(usable), s.normals.resize(usable), s.sums.resize(usable);
        s.strengths.resize(usable), s.strong_votes.resize(usable);
        parallel_for(Device{}, splats.size(),
                     BeginBody{splats.means, field.flags.span(), field.targets.span()});
        parallel_for(Device{}, usable, MeanBody{ranks, s.means.span()});
        find_tau(at_centres);
        s.times.done("records");
    }

    /// Votes of the splats with a tensor and of the fixed voters.
    void plate_round() {
        s.total(kSaliency, splats.size(),
                SaliencyTerm{field.eigenvalues.span(), field.flags.span()});
        s.total(kTensorCount, splats.size(), FlagTerm{kHasTensor, field.flags.span()});
        vote_at_centres(false);
    }

    /// Sums the votes at the centres and derives tensors and normals.
    void vote_at_centres(bool ball_round) {
        parallel_for(Device{}, voters,
                     OrientationBody{ranks, options.strength == VoteStrength::literal,
                                     s.totals.data() + kSaliency, field.eigenvalues.span(),
                                     field.normals.span(), field.flags.span(),
                                     s.voter_normals.span(), s.voter_strengths.span()});
        make_records(ball_round, at_centres);
        s.times.done("records");
        for_each_warp(
            Device{}, usable, 0,
            CentreRoundBody<Real, Lists>{received(), ball_round, ranks, field.flags.span(),
                                         s.sums.span(), s.strengths.span(), s.strong_votes.span()});
        s.times.done("centres");
        parallel_for(Device{}, usable,
                     EigenBody{ball_round, ranks, s.sums.span(), field.tensors.span(),
                               field.eigenvalues.span(), field.normals.span(), field.flags.span(),
                               s.normals.span()});
        s.times.done("eigen");
    }

    /// Selects the splats that take part in the position loss.
    void mask_positions() {
        s.variability.resize(usable), s.left_out.resize(usable);
        for_each_warp(Device{}, usable, Lists::scratch_bytes(k),
                      VariabilityBody<Lists>{k, lists, ranks, s.normals.span(), field.flags.span(),
                                             s.variability.span(), s.strengths.span()});
        s.total(kValidCount, splats.size(), FlagTerm{kNormalValid, field.flags.span()});
        sort_copy(s.variability, s.sorted_variability);
        sort_copy(s.strengths, s.sorted_strengths);
        parallel_for(Device{}, usable,
                     MaskBody{ranks, float(options.min_votes), s.totals.data() + kValidCount,
                              s.variability.span(), s.strengths.span(), s.sorted_variability.span(),
                              s.sorted_strengths.span(), s.strong_votes.span(), field.flags.span(),
                              s.left_out.span()});
        s.times.done("masks");
    }

    /// Sets the targets from the votes of the plate round's voters.
    void vote_at_virtual_receivers() {
        const bool same_voters = options.flatness_limit_position == options.flatness_limit;
        if (!same_voters) {
            s.position_tau.resize(voters);
            const Whitened<Device> at_positions{
                whiten_rule(options, options.flatness_limit_position),
                s.totals.data() + kPositionNoise, s.position_tau};
            find_tau(at_positions);
            make_records(false, at_positions);
            s.times.done("records");
        }
        const auto vote = [&]<bool kUnitVotes>() {
            for_each_warp(Device{}, usable, 0,
                          VirtualBody<Real, Lists, kUnitVotes>{
                              received(), same_voters, options.virtual_range,
                              std::max(options.target_margin, kRoundingMargin), ranks,
                              field.eigenvalues.span(), field.normals.span(), field.targets.span(),
                              field.flags.span()});
        };
        if (options.vote_map == VoteMap::unit)
            vote.template operator()<true>();
        else
            vote.template operator()<false>();
        s.times.done("virtual");
    }

    void find_tau(const Whitened<Device>& whitened) {
        parallel_for(Device{}, voters,
                     WhiteningBody<Real>{ranks, whitened.rule, whitened.noise, records.span()});
        for_each_warp(Device{}, voters,
                      median_scratch<Device>(k) * sizeof(float) + Lists::scratch_bytes(k),
                      TauBody<Real, Lists>{float(tau_per_median), k, lists, s.means.span(),
                                           records.span(), whitened.tau.span()});
    }

    void make_records(bool ball_round, const Whitened<Device>& whitened) {
        parallel_for(Device{}, voters,
                     RecordBody<Real>{ball_round, ranks, whitened.rule, whitened.noise,
                                      options.curvature == Curvature::scale_free, tau_per_median,
                                      whitened.tau.span(), s.voter_normals.span(),
                                      s.voter_strengths.span(), records.span()});
    }

    ReceivedVotes<Real, Lists> received() const {
        return {records.span(), s.means.span(), lists, vote_rule(options)};
    }

    void sort_copy(const Buffer<float, Device>& from, Buffer<float, Device>& to) {
        tvsgs::copy(from, to);
        sort(to, s.scratch.sort);
    }
};

}  // namespace tvsgs::detail
