// The order of one voting event, the same for both twins; instantiated in voting.cpp and voting.cu.
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>

#include "core/error.h"
#include "tv/internal/neighbours_impl.h"
#include "tv/internal/voting_virtual.h"

namespace tvsgs {

namespace detail {
// Defined in voting.cpp: CUDA sources do not see the log.
void warn_too_few(int usable, int count);
void warn_noise(double share);

enum Sum { kNoise, kPositionNoise, kUsable, kSaliency, kTensorCount, kValidCount, kSums };

/// Waits for the device and notes what each stage took; does nothing unless asked to.
template <class Device>
class StageTimes {
public:
    bool on = false;
    std::vector<VotingStage> stages;

    void begin() {
        if (!on) return;
        stages.clear();
        last_ = now();
    }
    void done(const char* name) {
        if (!on) return;
        const auto time = now();
        stages.push_back({name, std::chrono::duration<double, std::milli>(time - last_).count()});
        last_ = time;
    }
    void skip() { last_ = now(); }

private:
    using Clock = std::chrono::steady_clock;
    static Clock::time_point now() {
        synchronize(Device{});
        return Clock::now();
    }
    Clock::time_point last_;
};
}  // namespace detail

template <class Device>
struct TensorVoter<Device>::State {
    bool stale = true;     // lists do not fit the splats
    bool changed = false;  // since the last event
    int refreshed_at = 0;
    int listed = -1;        // splats at the last search
    bool no_balls = false;  // every splat in the lists has a tensor
    bool warned_few = false, warned_noise = false;
    detail::StageTimes<Device> times;
    VotingProfile profile;

    Neighbours<Device> neighbours;
    NeighbourScratch<Device> scratch;
    Buffer<Vec3f, Device> fixed_means, fixed_normals;
    Buffer<float, Device> fixed_scales, fixed_weights;
    std::vector<int> fixed_order;  // their places as given

    // Of the voters: splats by rank, then fixed voters.
    Buffer<VoterRecord<float>, Device> records;
    Buffer<VoterRecord<double>, Device> double_records;
    // Of those whose lists are here.
    Buffer<float, Device> tau, position_tau, voter_strengths;
    Buffer<Vec3f, Device> voter_normals;
    // Of the splats that take part, by rank.
    Buffer<detail::RankVector, Device> means, normals;
    Buffer<float, Device> sorted_strengths, sorted_variability;
    // Of those whose lists are here.
    Buffer<Sym3f, Device> sums;
    Buffer<float, Device> strengths, variability, strong_votes;
    Buffer<std::uint8_t, Device> left_out;
    Buffer<double, Device> partial, totals;

    // Scratch of structure_changed() and share_field().
    Buffer<Sym3f, Device> tensors;
    Buffer<Vec3f, Device> vectors;
    Buffer<std::uint8_t, Device> flags;

    FixedVoterSpans fixed() const {
        return {fixed_means.span(), fixed_normals.span(), fixed_scales.span(),
                fixed_weights.span()};
    }
    template <class Real>
    auto& records_of() {
        if constexpr (sizeof(Real) == sizeof(float))
            return records;
        else
            return double_records;
    }
    template <class Term>
    void total(detail::Sum which, int count, const Term& term) {
        add_sum(Device{}, count, term, 1, partial.span(), totals.data() + which);
    }
    template <class Term>
    std::int64_t total_now(int count, const Term& term) {
        return static_cast<std::int64_t>(detail::sum_now(scratch, count, term));
    }
    template <class... Buffers>
    static std::size_t bytes_of(const Buffers&... buffers) {
        return (... + (buffers.size() * sizeof(*buffers.data())));
    }
    std::size_t bytes() const {
        const auto& n = neighbours;
        const auto& s = scratch;
        std::size_t tiles = 0;
        for (const auto* t : {&neighbours.tiles, &neighbours.received})
            tiles += bytes_of(t->tiles, t->receiver_block, t->place, t->voter_block, t->voter_begin,
                              t->receiver_begin);
        return tiles + bytes_of(n.points, n.receivers, n.begin, n.voters) +
               bytes_of(s.sort.temporary, s.sort.keys, s.sort.values, s.sort.floats, s.values,
                        s.codes, s.order, s.nodes, s.cursors, s.begin, s.rows, s.counts) +
               bytes_of(fixed_means, fixed_normals, fixed_scales, fixed_weights) +
               bytes_of(records, double_records, tau, position_tau, voter_strengths, voter_normals,
                        means, normals, sums, strengths, variability, strong_votes,
                        sorted_strengths, sorted_variability, left_out, tensors, vectors, flags);
    }
};

template <class Device>
TensorVoter<Device>::TensorVoter(const TvOptions& options, Communicator* peers)
    : options_(options), peers_(peers), state_(new State) {}

template <class Device>
TensorVoter<Device>::~TensorVoter() = default;

template <class Device>
bool TensorVoter<Device>::due(int step, int batch) const {
    return options_.enabled && step >= options_.start &&
           ((step - options_.start) % options_.vote_every < batch || state_->changed);
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

}  // namespace detail

template <class Device>
void TensorVoter<Device>::refresh(int step, const SplatSpans& splats) {
    State& s = *state_;
    // Where memory counts, the search has what the event does not need meanwhile.
    if (options_.lists == ListStorage::compact) detail::free_memory(s.records, s.double_records);
    find_neighbours(
        {splats, s.fixed(), options_.k, detail::whiten_rule(options_, options_.flatness_limit),
         s.totals.data() + detail::kNoise, s.times.on, options_.lists, peers_},
        s.scratch, s.neighbours, [&s](const char* stage) { s.times.done(stage); });
    s.refreshed_at = step;
    s.listed = splats.size();
    s.stale = s.no_balls = false;  // vote() counts anew
    const Neighbours<Device>& found = s.neighbours;
    if (found.k == 0 && !std::exchange(s.warned_few, true))
        detail::warn_too_few(found.usable, splats.size());
    // Of a splat's size: what is thinner is no longer told apart. A few giants raise the mean.
    constexpr double kCoarse = 0.1;
    const double size = std::sqrt(std::max(double(found.median_trace), 1e-300) / 3),
                 share = std::sqrt(found.noise) / size;
    if (found.k > 0 && share > kCoarse && options_.whiten_noise_mode == NoiseMode::global &&
        !std::exchange(s.warned_noise, true))
        detail::warn_noise(share);
}

/// The regulariser of the whitening: 1e-4 of the mean trace.
template <class Device>
void TensorVoter<Device>::measure_noise(const SplatSpans& splats) {
    using namespace detail;
    State& s = *state_;
    const int count = splats.size();
    s.partial.resize(kSumBlocks), s.totals.resize(kSums);
    s.totals.fill_zero();
    s.total(kUsable, count, UsableSplatTerm{splats});
    s.total(kNoise, count, NoiseTerm{splats, options_.flatness_limit});
    s.total(kPositionNoise, count, NoiseTerm{splats, options_.flatness_limit_position});
    for (const Sum noise : {kNoise, kPositionNoise})
        parallel_for(Device{}, 1, NoiseBody{s.totals.data() + kUsable, s.totals.data() + noise});
}

template <class Device>
auto TensorVoter<Device>::progress() const -> Progress {
    return {state_->stale ? -1 : state_->refreshed_at, state_->changed};
}

template <class Device>
void TensorVoter<Device>::restore(const Progress& progress, const Gaussians<Device>& searched) {
    state_->changed = progress.changed;
    state_->stale = progress.searched_at < 0;
    if (state_->stale) return;
    const SplatSpans splats = splat_spans(searched);
    measure_noise(splats);
    refresh(progress.searched_at, splats);
}

template <class Device>
void TensorVoter<Device>::vote(int step,
                               const Gaussians<Device>& gaussians,
                               TensorField<Device>& field,
                               bool targets) {
    using namespace detail;
    State& s = *state_;
    const int count = gaussians.size();
    const SplatSpans splats = splat_spans(gaussians);
    if (static_cast<int>(field.flags.size()) != count)
        clear(count, field);  // nothing was inherited
    s.stale = s.stale || s.listed != count;
    s.changed = false;
    s.times.begin();

    measure_noise(splats);
    if (s.stale || step - s.refreshed_at >= options_.refresh_every || step < s.refreshed_at) {
        refresh(step, splats);
        const Ranks ranks{s.neighbours.points.span(), splats, s.fixed()};
        s.no_balls = s.neighbours.k > 0 &&
                     s.total_now(ranks.usable(), RankTensorTerm{ranks, field.flags.span()}) ==
                         ranks.usable();
    }
    if (s.neighbours.k == 0) {
        clear(count, field);
        return;
    }
    const auto run = [&](const auto& lists) {
        if (options_.precision == VotePrecision::single_precision)
            event<float>(lists, splats, targets, field);
        else
            event<double>(lists, splats, targets, field);
    };
    if (s.neighbours.storage == ListStorage::full)
        run(s.neighbours.full_lists());
    else
        run(s.neighbours.compact_lists());
}

/// The event itself, on lists that are up to date.
template <class Device>
template <class Real, class Lists>
void TensorVoter<Device>::event(const Lists& lists,
                                const SplatSpans& splats,
                                bool targets,
                                TensorField<Device>& field) {
    using namespace detail;
    State& s = *state_;
    const Neighbours<Device>& near = s.neighbours;
    const Ranks ranks{near.points.span(), splats, s.fixed()};
    const int usable = ranks.usable(), voters = ranks.size();
    // Each process has lists of these, and shares what it finds by them.
    const Part own_voters = near.own_voters, own = near.own_receivers;
    auto& records = s.template records_of<Real>();
    records.resize(voters), s.means.resize(usable), s.normals.resize(usable);
    s.tau.resize(own_voters.size());
    s.voter_strengths.resize(own_voters.size()), s.voter_normals.resize(own_voters.size());
    s.sums.resize(own.size()), s.strengths.resize(own.size()), s.strong_votes.resize(own.size());
    const auto by_voter = [&](auto& values) { return PartSpan{values.span(), own_voters.begin}; };
    const auto by_rank = [&](auto& values) { return PartSpan{values.span(), own.begin}; };
    const auto for_voters = [&](const auto& body) {
        parallel_for(Device{}, own_voters.size(), from(own_voters.begin, body));
    };
    const auto for_own_warps = [&](std::size_t scratch_bytes, const auto& body) {
        for_each_warp(Device{}, own.size(), scratch_bytes, from(own.begin, body));
    };

    const double tau_per_median =
        options_.scale_rule == ScaleRule::median ? 1 : 1 / std::sqrt(kLn10);
    const auto find_tau = [&](float flatness_limit, Sum noise, Buffer<float, Device>& tau) {
        for_voters(WhiteningBody<Real>{ranks, whiten_rule(options_, flatness_limit),
                                       s.totals.data() + noise, records.span()});
        for_each_warp(Device{}, own_voters.size(),
                      median_scratch<Device>(near.k) * sizeof(float) + Lists::scratch_bytes(near.k),
                      from(own_voters.begin,
                           TauBody<Real, Lists>{static_cast<float>(tau_per_median), near.k, lists,
                                                s.means.span(), records.span(), by_voter(tau)}));
    };
    const auto make_records = [&](bool ball_round, float flatness_limit, Sum noise,
                                  Buffer<float, Device>& tau) {
        for_voters(RecordBody<Real>{
            ball_round, ranks, whiten_rule(options_, flatness_limit), s.totals.data() + noise,
            options_.curvature == Curvature::scale_free, tau_per_median,
            by_voter(std::as_const(tau)), by_voter(std::as_const(s.voter_normals)),
            by_voter(std::as_const(s.voter_strengths)), records.span()});
        share_parts(peers_, "voters", Device{}, records.data(), voters);
    };

    // 1. What holds for all rounds: centres, and scales of voting.
    parallel_for(Device{}, splats.size(),
                 BeginBody{splats.means, field.flags.span(), field.targets.span()});
    parallel_for(Device{}, usable, MeanBody{ranks, s.means.span()});
    find_tau(options_.flatness_limit, kNoise, s.tau);
    s.times.done("records");

    // 2. A ball round among the splats without a tensor, then a plate round.
    const Ballot<Real, Lists> ballot{records.span(), s.means.span(), lists, vote_rule(options_)};
    for (const bool ball_round : {true, false}) {
        if (ball_round && s.no_balls) continue;
        if (!ball_round) {
            s.total(kSaliency, splats.size(),
                    SaliencyTerm{field.eigenvalues.span(), field.flags.span()});
            s.total(kTensorCount, splats.size(), FlagTerm{kHasTensor, field.flags.span()});
        }
        for_voters(OrientationBody{ranks, options_.strength == VoteStrength::literal,
                                   s.totals.data() + kSaliency, field.eigenvalues.span(),
                                   field.normals.span(), field.flags.span(),
                                   by_voter(s.voter_normals), by_voter(s.voter_strengths)});
        make_records(ball_round, options_.flatness_limit, kNoise, s.tau);
        s.times.done("records");
        for_own_warps(0, CentreRoundBody<Real, Lists>{ballot, ball_round, ranks, field.flags.span(),
                                                      by_rank(s.sums), by_rank(s.strengths),
                                                      by_rank(s.strong_votes)});
        s.times.done("centres");
        parallel_for(
            Device{}, own.size(),
            from(own.begin, EigenBody{ball_round, ranks, by_rank(std::as_const(s.sums)),
                                      field.tensors.span(), field.eigenvalues.span(),
                                      field.normals.span(), field.flags.span(), s.normals.span()}));
        share_field(field.tensors, s.tensors);
        share_field(field.eigenvalues, s.vectors);
        share_field(field.normals, s.vectors);
        share_field(field.flags, s.flags);
        s.times.done("eigen");
    }
    if (s.times.on) count_votes(ballot);
    if (!targets) {
        parallel_for(Device{}, splats.size(), ClearPositionBody{field.flags.span()});
        return;
    }

    // 3. Masks of the position loss.
    s.variability.resize(own.size()), s.left_out.resize(own.size());
    share_ranks(s.normals.data());
    for_own_warps(Lists::scratch_bytes(near.k),
                  VariabilityBody<Lists>{near.k, lists, ranks, s.normals.span(), field.flags.span(),
                                         by_rank(s.variability), by_rank(s.strengths)});
    s.total(kValidCount, splats.size(), FlagTerm{kNormalValid, field.flags.span()});
    gather_ranks(s.variability, s.sorted_variability);
    gather_ranks(s.strengths, s.sorted_strengths);
    sort(s.sorted_variability, s.scratch.sort);
    sort(s.sorted_strengths, s.scratch.sort);
    parallel_for(
        Device{}, own.size(),
        from(own.begin,
             MaskBody{ranks, static_cast<float>(options_.min_votes), s.totals.data() + kValidCount,
                      by_rank(std::as_const(s.variability)), by_rank(std::as_const(s.strengths)),
                      by_rank(std::as_const(s.strong_votes)), s.sorted_variability.span(),
                      s.sorted_strengths.span(), field.flags.span(), by_rank(s.left_out)}));
    s.times.done("masks");

    if (options_.targets == Targets::anchor) {
        share_field(field.flags, s.flags);
        parallel_for(Device{}, splats.size(), AnchorBody{field.flags.span()});
        return;
    }

    // 4. Virtual receivers, by the voters of the plate round just done.
    const bool same_voters = options_.flatness_limit_position == options_.flatness_limit;
    if (!same_voters) {
        s.position_tau.resize(own_voters.size());
        find_tau(options_.flatness_limit_position, kPositionNoise, s.position_tau);
        make_records(false, options_.flatness_limit_position, kPositionNoise, s.position_tau);
        s.times.done("records");
    }
    const auto vote_at_virtual_receivers = [&]<bool kUnitVotes>() {
        for_own_warps(0, VirtualBody<Real, Lists, kUnitVotes>{
                             ballot, same_voters, options_.virtual_range,
                             std::max(options_.target_margin, kRoundingMargin), ranks,
                             field.eigenvalues.span(), field.normals.span(), field.targets.span(),
                             field.flags.span()});
    };
    if (options_.vote_map == VoteMap::unit)
        vote_at_virtual_receivers.template operator()<true>();
    else
        vote_at_virtual_receivers.template operator()<false>();
    share_field(field.targets, s.vectors);
    share_field(field.flags, s.flags);
    s.times.done("virtual");
}

template <class Device>
template <class T>
void TensorVoter<Device>::share_ranks(T* data) {
    if (peers_ == nullptr) return;
    const Neighbours<Device>& near = state_->neighbours;
    std::vector<std::size_t> begins = part_begins(near.voters_count, peers_->size());
    for (std::size_t& begin : begins) begin = std::min(begin, std::size_t(near.usable));
    peers_->share("votes", Device{}, data, begins);
}

template <class Device>
template <class T>
void TensorVoter<Device>::share_field(Buffer<T, Device>& values, Buffer<T, Device>& scratch) {
    if (peers_ == nullptr) return;
    State& s = *state_;
    const Part own = s.neighbours.own_receivers;
    // Of the splats only the places of their ranks are asked for.
    const detail::Ranks ranks{s.neighbours.points.span(), {}, {}};
    scratch.resize(ranks.usable());
    parallel_for(Device{}, own.size(),
                 from(own.begin, detail::ToRanksBody<T>{ranks, values.span(), scratch.span()}));
    share_ranks(scratch.data());
    parallel_for(Device{}, ranks.usable(),
                 detail::ToSplatsBody<T>{ranks, scratch.span(), values.span()});
}

template <class Device>
void TensorVoter<Device>::gather_ranks(const Buffer<float, Device>& part,
                                       Buffer<float, Device>& all) {
    const Neighbours<Device>& near = state_->neighbours;
    all.resize(near.usable);
    tvsgs::detail::copy(Device{}, part.data(), Device{}, all.data() + near.own_receivers.begin,
                        part.size() * sizeof(float));
    share_ranks(all.data());
}

/// Counters of the round just done, for the profile.
template <class Device>
template <class Ballot>
void TensorVoter<Device>::count_votes(const Ballot& ballot) {
    State& s = *state_;
    const Part own = s.neighbours.own_receivers;
    s.sorted_strengths.resize(own.size()), s.sorted_variability.resize(own.size());
    for_each_warp(Device{}, own.size(), 0,
                  from(own.begin,
                       detail::VoteCountBody{ballot, PartSpan{s.sorted_strengths.span(), own.begin},
                                             PartSpan{s.sorted_variability.span(), own.begin}}));
    s.profile.votes = s.total_now(own.size(), detail::ValueTerm{s.sorted_strengths.span()});
    s.profile.culled_votes =
        s.total_now(own.size(), detail::ValueTerm{s.sorted_variability.span()});
    s.profile.silent_voters =
        s.total_now(static_cast<int>(s.tau.size()), detail::SilentTerm{s.tau.span()});
    s.times.skip();
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
void TensorVoter<Device>::set_fixed_voters(const FixedVoters& voters) {
    State& s = *state_;
    Buffer<int, Cpu> order;  // Morton order, as the splats': near in space, near in memory
    morton_order(Span<const Vec3f>{voters.means.data(), voters.means.size()}, order);
    s.fixed_order = to_host(order);
    const auto in_order = [&](auto values) {
        const auto given = values;
        for (std::size_t i = 0; i < given.size(); ++i) values[i] = given[s.fixed_order[i]];
        return values;
    };
    copy(in_order(voters.means), s.fixed_means);
    copy(in_order(voters.normals), s.fixed_normals);
    copy(in_order(voters.scales), s.fixed_scales);
    copy(in_order(voters.weights), s.fixed_weights);
    s.stale = true;
}

template <class Device>
void TensorVoter<Device>::set_profiling(bool on) {
    state_->times.on = on;
}

template <class Device>
VotingProfile TensorVoter<Device>::profile() const {
    const State& s = *state_;
    VotingProfile result = s.profile;
    for (const VotingStage& stage : s.times.stages) {  // one entry for each name
        const auto same = std::find_if(result.stages.begin(), result.stages.end(),
                                       [&](const auto& other) { return other.name == stage.name; });
        if (same == result.stages.end())
            result.stages.push_back(stage);
        else
            same->ms += stage.ms;
    }
    result.bytes = s.bytes();
    result.candidates = s.neighbours.candidates;
    result.leaves = s.neighbours.leaves;
    return result;
}

}  // namespace tvsgs

#include "tv/internal/voting_details.h"
