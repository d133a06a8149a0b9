// Implementation of TensorVoter: when it searches and votes, and how growth changes the field.
// voting_event.h holds one event. voting.cpp and voting.cu instantiate it for their device.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>

#include "tv/internal/voting_event.h"

namespace tvsgs {

namespace detail {
// Defined in voting.cpp, because CUDA sources do not include the log.
void warn_too_few(int usable, int count);
void warn_noise(double share);

template <class Device>
void clear(int count, TensorField<Device>& field) {
    const auto zeros = [&](auto&... buffers) {
        (buffers.resize(count), ...);
        (buffers.fill_zero(), ...);
    };
    zeros(field.tensors, field.eigenvalues, field.normals, field.targets, field.flags);
}
}  // namespace detail

template <class Device>
TensorVoter<Device>::TensorVoter(const TvOptions& options)
    : options_(options), state_(new detail::VotingState<Device>) {}

template <class Device>
TensorVoter<Device>::~TensorVoter() = default;

template <class Device>
bool TensorVoter<Device>::due(int step) const {
    return options_.enabled && step >= options_.start &&
           ((step - options_.start) % options_.vote_every == 0 || state_->changed);
}

template <class Device>
void TensorVoter<Device>::vote(int step,
                               const Gaussians<Device>& gaussians,
                               TensorField<Device>& field,
                               bool targets) {
    auto& s = *state_;
    const int count = gaussians.size();
    const SplatSpans splats = splat_spans(gaussians);
    if (static_cast<int>(field.flags.size()) != count)
        detail::clear(count, field);  // nothing was inherited
    s.stale = s.stale || s.listed != count;
    s.changed = false;
    s.times.begin();

    measure_noise(splats);
    if (s.stale || step - s.searched_at >= options_.refresh_every || step < s.searched_at)
        search(step, splats);
    if (std::exchange(s.new_lists, false)) {
        const detail::Ranks ranks = s.ranks(splats);
        s.all_have_tensors =
            s.neighbours.k > 0 &&
            s.total_on_host(ranks.usable(), detail::RankTensorTerm{ranks, field.flags.span()}) ==
                ranks.usable();
    }
    if (s.neighbours.k == 0) return detail::clear(count, field);
    const auto vote_on = [&]<class Lists>(const Lists& lists) {
        if (options_.precision == VotePrecision::single_precision)
            detail::VotingEvent<float, Lists, Device>{options_, lists, splats, s, field}.run(
                targets);
        else
            detail::VotingEvent<double, Lists, Device>{options_, lists, splats, s, field}.run(
                targets);
    };
    if (s.neighbours.storage == ListStorage::full)
        vote_on(s.neighbours.full_lists());
    else
        vote_on(s.neighbours.compact_lists());
}

/// Computes the regulariser of the whitening: 1e-4 of the mean trace.
template <class Device>
void TensorVoter<Device>::measure_noise(const SplatSpans& splats) {
    using namespace detail;
    auto& s = *state_;
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
void TensorVoter<Device>::search(int step, const SplatSpans& splats) {
    auto& s = *state_;
    // Compact lists serve large scenes, so the search reuses the memory of the event's records.
    if (options_.lists == ListStorage::compact) detail::free_memory(s.records, s.double_records);
    find_neighbours(
        {splats, s.fixed(), options_.k, detail::whiten_rule(options_, options_.flatness_limit),
         s.totals.data() + detail::kNoise, s.times.on, options_.lists},
        s.scratch, s.neighbours, [&s](const char* stage) { s.times.done(stage); });
    s.searched_at = step;
    s.listed = splats.size();
    s.stale = s.all_have_tensors = false;
    s.new_lists = true;  // vote() counts the tensors
    const Neighbours<Device>& found = s.neighbours;
    if (found.k == 0 && !std::exchange(s.warned_few, true))
        detail::warn_too_few(found.usable, splats.size());
    // Regulariser relative to the median splat. A few giant splats raise the mean trace and with it
    // the regulariser, which then makes the small splats rounder.
    constexpr double kCoarse = 0.1;
    const double size = std::sqrt(std::max(double(found.median_trace), 1e-300) / 3),
                 share = std::sqrt(found.noise) / size;
    if (found.k > 0 && share > kCoarse && options_.whiten_noise_mode == NoiseMode::global &&
        !std::exchange(s.warned_noise, true))
        detail::warn_noise(share);
}

template <class Device>
void TensorVoter<Device>::structure_changed(Span<const int> parents, TensorField<Device>& field) {
    auto& s = *state_;
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
    auto& s = *state_;
    Buffer<int, Cpu> order;  // Morton order: near in space, near in memory
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
auto TensorVoter<Device>::progress() const -> Progress {
    return {state_->stale ? -1 : state_->searched_at, state_->changed};
}

template <class Device>
void TensorVoter<Device>::restore(const Progress& progress, const Gaussians<Device>& searched) {
    state_->changed = progress.changed;
    state_->stale = progress.searched_at < 0;
    if (state_->stale) return;
    const SplatSpans splats = splat_spans(searched);
    measure_noise(splats);
    search(progress.searched_at, splats);
}

template <class Device>
void TensorVoter<Device>::set_profiling(bool on) {
    state_->times.on = on;
}

template <class Device>
VotingProfile TensorVoter<Device>::profile() const {
    const auto& s = *state_;
    VotingProfile result = s.profile;
    for (const VotingStage& stage : s.times.stages) {  // adds up stages of one name
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
