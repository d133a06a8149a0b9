// The order of one voting event, the same for both twins; instantiated in voting.cpp and voting.cu.
#pragma once

#include <cmath>

#include "core/error.h"
#include "tv/neighbours.h"
#include "tv/voting_bodies.h"

namespace tvsgs {

namespace detail {
// Defined in voting.cpp: CUDA sources do not see the log.
void warn_too_few(int usable, int count);
void warn_giant(double ratio);

enum Sum { kNoise, kPositionNoise, kUsable, kSaliency, kTensorCount, kValidCount, kSums };
}  // namespace detail

template <class Device>
struct TensorVoter<Device>::State {
    using Real = VoteReal<Device>;

    bool stale = true;     // lists do not fit the splats
    bool changed = false;  // since the last event
    int refreshed_at = 0;
    int listed = -1;  // splats at the last search
    bool warned_few = false, warned_giant = false;

    Neighbours<Device> neighbours;
    NeighbourScratch<Device> scratch;
    Buffer<VoterRecord<Real>, Device> records;
    Buffer<float, Device> tau, strengths, variability, strong_votes, voter_strengths;
    Buffer<float, Device> sorted_strengths, sorted_variability;
    Buffer<Vec3f, Device> voter_normals;
    Buffer<Sym3f, Device> sums;
    Buffer<std::uint8_t, Device> left_out;
    Buffer<double, Device> partial, totals;

    // Scratch of structure_changed().
    Buffer<Sym3f, Device> tensors;
    Buffer<Vec3f, Device> vectors;
    Buffer<std::uint8_t, Device> flags;

    template <class Term>
    void total(detail::Sum which, int count, const Term& term) {
        add_sum(Device{}, count, term, 1, partial.span(), totals.data() + which);
    }
    void resize(int count) {
        records.resize(count), tau.resize(count), strengths.resize(count),
            variability.resize(count);
        strong_votes.resize(count), voter_strengths.resize(count), voter_normals.resize(count);
        sums.resize(count), left_out.resize(count);
        // Splats that take no part are skipped by the kernels, and their entries still get read.
        tau.fill_zero(), strengths.fill_zero(), variability.fill_zero(), left_out.fill_zero();
        partial.resize(kSumBlocks), totals.resize(detail::kSums);
        totals.fill_zero();
    }
};

template <class Device>
TensorVoter<Device>::TensorVoter(const TvOptions& options) : options_(options), state_(new State) {}

template <class Device>
TensorVoter<Device>::~TensorVoter() = default;

template <class Device>
bool TensorVoter<Device>::due(int step) const {
    return options_.enabled && step >= options_.start &&
           ((step - options_.start) % options_.vote_every == 0 || state_->changed);
}

namespace detail {

template <class Device>
void clear(int count, TensorField<Device>& field) {
    field.tensors.resize(count), field.eigenvalues.resize(count), field.normals.resize(count);
    field.targets.resize(count), field.flags.resize(count);
    field.tensors.fill_zero(), field.eigenvalues.fill_zero(), field.normals.fill_zero();
    field.targets.fill_zero(), field.flags.fill_zero();
}

inline WhitenRule whiten_rule(const TvOptions& o, float flatness_limit) {
    return {o.whiten, o.whiten_noise_mode == NoiseMode::per_splat, flatness_limit};
}

inline VoteRule vote_rule(const TvOptions& o) {
    const double sine = std::sin(o.max_vote_angle_deg * kPi / 180);
    return {o.vote_map == VoteMap::unit,
            o.max_vote_angle_deg < 90 ? static_cast<float>(sine * sine) : 2.0f};
}

/// Copies without another allocation per call, then sorts.
template <class Device>
void sorted_copy(const Buffer<float, Device>& from,
                 Buffer<float, Device>& to,
                 SortScratch<Device>& scratch) {
    tvsgs::copy(from, to);
    sort(to, scratch);
}

}  // namespace detail

template <class Device>
void TensorVoter<Device>::refresh(int step, const Gaussians<Device>& gaussians) {
    State& s = *state_;
    const SplatSpans splats = splat_spans(gaussians);
    find_neighbours(splats, options_.k, detail::whiten_rule(options_, options_.flatness_limit),
                    s.totals.data() + detail::kNoise, s.scratch, s.neighbours);
    s.refreshed_at = step;
    s.stale = false;
    const Neighbours<Device>& found = s.neighbours;
    if (found.k == 0 && !std::exchange(s.warned_few, true))
        detail::warn_too_few(found.usable, splats.size());
    constexpr double kGiant =
        1e4;  // in standard deviations: the global regulariser is then as large as most splats
    const double ratio =
        std::sqrt(double(found.largest_trace) / std::max(double(found.median_trace), 1e-300));
    if (found.k > 0 && ratio > kGiant && options_.whiten_noise_mode == NoiseMode::global &&
        !std::exchange(s.warned_giant, true))
        detail::warn_giant(ratio);
}

/// Records of all voters for votes with one flatness limit; orient_records() completes them.
template <class Device>
void TensorVoter<Device>::build_records(const SplatSpans& splats,
                                        float flatness_limit,
                                        bool keep_tau) {
    State& s = *state_;
    using Real = typename State::Real;
    const double per_median = options_.scale_rule == ScaleRule::median ? 1 : 1 / std::sqrt(kLn10);
    const double* noise = s.totals.data() + (keep_tau ? detail::kNoise : detail::kPositionNoise);
    for_each_warp(
        Device{}, splats.size(), s.neighbours.k * sizeof(Real),
        detail::RecordBody<Real>{splats, detail::whiten_rule(options_, flatness_limit), noise,
                                 Real(per_median), s.neighbours.k, s.neighbours.receivers.span(),
                                 s.records.span(), keep_tau ? s.tau.span() : Span<float>{}});
}

template <class Device>
void TensorVoter<Device>::orient_records(const SplatSpans& splats,
                                         float flatness_limit,
                                         bool position) {
    State& s = *state_;
    parallel_for(Device{}, splats.size(),
                 detail::OrientBody<typename State::Real>{
                     splats, detail::whiten_rule(options_, flatness_limit),
                     s.totals.data() + (position ? detail::kPositionNoise : detail::kNoise),
                     s.voter_normals.span(), s.voter_strengths.span(), s.records.span()});
}

template <class Device>
void TensorVoter<Device>::vote(int step,
                               const Gaussians<Device>& gaussians,
                               TensorField<Device>& field) {
    using namespace detail;
    using Real = typename State::Real;
    State& s = *state_;
    const int count = gaussians.size();
    if (static_cast<int>(field.flags.size()) != count)
        clear(count, field);  // nothing was inherited
    s.stale = s.stale || s.listed != count;
    s.changed = false;
    s.resize(count);
    const SplatSpans splats = splat_spans(gaussians);

    // 1. The regulariser of the whitening: 1e-4 of the mean trace.
    s.total(kUsable, count, UsableSplatTerm{splats});
    s.total(kNoise, count, NoiseTerm{splats, options_.flatness_limit});
    s.total(kPositionNoise, count, NoiseTerm{splats, options_.flatness_limit_position});
    for (const Sum noise : {kNoise, kPositionNoise})
        parallel_for(Device{}, 1, NoiseBody{s.totals.data() + kUsable, s.totals.data() + noise});

    // 2. Lists, when they are due; scales of voting always.
    if (s.stale || step - s.refreshed_at >= options_.refresh_every || step < s.refreshed_at) {
        refresh(step, gaussians);
        s.listed = count;
    }
    const Neighbours<Device>& near = s.neighbours;
    if (near.k == 0) {
        clear(count, field);
        return;
    }
    build_records(splats, options_.flatness_limit, true);

    // 3. A ball round among the splats without a tensor, then a plate round.
    const Ballot<Real> ballot{s.records.span(), splats.means, near.begin.span(), near.voters.span(),
                              vote_rule(options_)};
    for (const bool ball_round : {true, false}) {
        if (!ball_round) {
            s.total(kSaliency, count, SaliencyTerm{field.eigenvalues.span(), field.flags.span()});
            s.total(kTensorCount, count, FlagTerm{kHasTensor, field.flags.span()});
        }
        parallel_for(
            Device{}, count,
            StrengthBody{options_.strength == VoteStrength::literal, s.totals.data() + kSaliency,
                         field.eigenvalues.span(), field.normals.span(), field.flags.span(),
                         s.voter_normals.span(), s.voter_strengths.span()});
        orient_records(splats, options_.flatness_limit, false);
        for_each_warp(Device{}, count, 0,
                      CentreRoundBody<Real>{ballot, ball_round, field.flags.span(), s.sums.span(),
                                            s.strengths.span(), s.strong_votes.span()});
        parallel_for(Device{}, count,
                     EigenBody{ball_round, s.sums.span(), field.tensors.span(),
                               field.eigenvalues.span(), field.normals.span(), field.flags.span()});
    }

    // 4. Masks.
    for_each_warp(Device{}, count, 0,
                  VariabilityBody{near.k, near.receivers.span(), field.normals.span(),
                                  field.flags.span(), s.variability.span(), s.strengths.span()});
    s.total(kValidCount, count, FlagTerm{kValidNow, field.flags.span()});
    sorted_copy(s.variability, s.sorted_variability, s.scratch.sort);
    sorted_copy(s.strengths, s.sorted_strengths, s.scratch.sort);
    parallel_for(Device{}, count,
                 MaskBody{static_cast<float>(options_.min_votes), s.totals.data() + kValidCount,
                          s.variability.span(), s.strengths.span(), s.sorted_variability.span(),
                          s.sorted_strengths.span(), s.strong_votes.span(), field.flags.span(),
                          s.left_out.span()});

    // 5. Virtual receivers, by the voters of the plate round just done.
    if (options_.flatness_limit_position != options_.flatness_limit) {
        build_records(splats, options_.flatness_limit_position, false);
        orient_records(splats, options_.flatness_limit_position, true);
    }
    for_each_warp(
        Device{}, count, 0,
        VirtualBody<Real>{ballot, options_.virtual_range, splats.log_scales, field.normals.span(),
                          field.targets.span(), field.flags.span()});
}

template <class Device>
void TensorVoter<Device>::structure_changed(Span<const int> parents, TensorField<Device>& field) {
    State& s = *state_;
    s.stale = s.changed = true;
    if (field.flags.empty()) return;  // no event yet
    const int count = parents.size();
    const auto inherit = [&]<class T>(Buffer<T, Device>& values, Buffer<T, Device>& scratch) {
        scratch.resize(count);
        parallel_for(Device{}, count,
                     detail::InheritBody<T>{parents, values.span(), scratch.span()});
        values.swap(scratch);
    };
    inherit(field.tensors, s.tensors);
    inherit(field.eigenvalues, s.vectors);
    inherit(field.normals, s.vectors);
    inherit(field.targets, s.vectors);
    inherit(field.flags, s.flags);
    parallel_for(Device{}, count, detail::ClearPositionBody{field.flags.span()});
}

template <class Device>
void TensorVoter<Device>::set_receivers(int step,
                                        int k,
                                        const std::vector<std::uint32_t>& receivers) {
    State& s = *state_;
    const int count = static_cast<int>(receivers.size()) / k;
    std::vector<std::int64_t> begin(std::size_t(count) + 1, 0);
    for (const std::uint32_t receiver : receivers) ++begin[receiver + std::size_t(1)];
    for (int i = 0; i < count; ++i) begin[i + 1] += begin[i];
    std::vector<std::int64_t> next = begin;
    std::vector<std::uint32_t> voters(receivers.size());
    for (std::size_t e = 0; e < receivers.size(); ++e)
        voters[next[receivers[e]]++] = static_cast<std::uint32_t>(e / k);
    copy(receivers, s.neighbours.receivers);
    copy(begin, s.neighbours.begin);
    copy(voters, s.neighbours.voters);
    s.neighbours.k = k;
    s.neighbours.usable = s.listed = count;
    s.refreshed_at = step;
    s.stale = false;
}

template <class Device>
VotingDetails TensorVoter<Device>::details() const {
    const State& s = *state_;
    return {s.neighbours.k,
            to_host(s.neighbours.receivers),
            to_host(s.neighbours.begin),
            to_host(s.neighbours.voters),
            to_host(s.tau),
            to_host(s.variability),
            to_host(s.strengths),
            to_host(s.left_out)};
}

}  // namespace tvsgs
