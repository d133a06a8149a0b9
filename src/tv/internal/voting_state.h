// State of a TensorVoter between events: lists, scratch memory and timings.
#pragma once

#include <algorithm>
#include <chrono>
#include <string_view>
#include <utility>

#include "core/device/parallel.h"
#include "tv/internal/neighbours_impl.h"
#include "tv/internal/voting_ranks.h"

namespace tvsgs::detail {

/// Sums over all splats, kept on the device.
enum Sum { kNoise, kPositionNoise, kUsable, kSaliency, kTensorCount, kValidCount, kSums };

/// Waits for the device and records the time of each stage; does nothing unless `on`.
template <class Device>
class StageTimes {
public:
    bool on = false;
    std::vector<StageTime> stages;  // adds up the times of one name

    void begin() {
        if (!on) return;
        stages.clear();
        last_ = now();
    }
    void done(const char* name) {
        if (!on) return;
        const auto begin = std::exchange(last_, now());
        auto stage = std::find_if(stages.begin(), stages.end(), [&](const StageTime& known) {
            return std::string_view(known.name) == name;
        });
        if (stage == stages.end()) stage = stages.insert(stage, {name, 0});
        stage->seconds += std::chrono::duration<double>(last_ - begin).count();
    }

private:
    using Clock = std::chrono::steady_clock;
    static Clock::time_point now() {
        synchronize(Device{});
        return Clock::now();
    }
    Clock::time_point last_;
};

template <class Device>
struct VotingState {
    bool stale = true;              // the lists do not fit the splats
    bool changed = false;           // structure_changed() since the last event
    bool new_lists = false;         // a search since the last event
    int searched_at = 0;            // iteration
    int listed = -1;                // number of splats at the last search
    bool all_have_tensors = false;  // all splats in the lists have one, so there is no ball round
    bool warned_few = false, warned_noise = false;
    StageTimes<Device> times;

    Neighbours<Device> neighbours;
    NeighbourScratch<Device> scratch;
    Buffer<Vec3f, Device> fixed_means, fixed_normals;  // in Morton order, like the next two
    Buffer<float, Device> fixed_scales, fixed_weights;
    std::vector<int> fixed_order;  // index of each in the given FixedVoters

    // [voters] splats by rank, then fixed voters.
    Buffer<VoterRecord<float>, Device> records;
    Buffer<VoterRecord<double>, Device> double_records;
    Buffer<float, Device> tau, position_tau, voter_strengths;
    Buffer<Vec3f, Device> voter_normals;
    // [usable] splats by rank.
    Buffer<RankVector, Device> means, normals;
    Buffer<Sym3f, Device> sums;
    Buffer<float, Device> strengths, variability, strong_votes;
    Buffer<std::uint8_t, Device> left_out;
    // [usable] ascending.
    Buffer<float, Device> sorted_strengths, sorted_variability;
    Buffer<double, Device> partial, totals;

    // Scratch of structure_changed().
    Buffer<Sym3f, Device> tensors;
    Buffer<Vec3f, Device> vectors;
    Buffer<std::uint8_t, Device> flags;

    FixedVoterSpans fixed() const {
        return {fixed_means.span(), fixed_normals.span(), fixed_scales.span(),
                fixed_weights.span()};
    }
    Ranks ranks(const SplatSpans& splats) const {
        return {neighbours.points.span(), splats, fixed()};
    }
    template <class Real>
    auto& records_of() {
        if constexpr (sizeof(Real) == sizeof(float))
            return records;
        else
            return double_records;
    }
    /// Adds the terms to totals[which].
    template <class Term>
    void total(Sum which, int count, const Term& term) {
        add_sum(Device{}, count, term, 1, partial.span(), totals.data() + which);
    }
    /// The sum on the host. Waits for the device.
    template <class Term>
    std::int64_t total_on_host(int count, const Term& term) {
        return std::int64_t(sum_on_host(scratch, count, term));
    }

    std::size_t bytes() const {
        const auto bytes_of = [](const auto&... buffers) {
            return (... + (buffers.size() * sizeof(*buffers.data())));
        };
        const auto& n = neighbours;
        const auto& s = scratch;
        const auto& t = neighbours.tiles;
        return bytes_of(n.points, n.receivers, n.begin, n.voters, t.tiles, t.receiver_block,
                        t.place, t.voter_block, t.voter_begin, t.receiver_begin) +
               bytes_of(s.sort.temporary, s.sort.keys, s.sort.values, s.sort.floats, s.values,
                        s.codes, s.order, s.nodes, s.cursors, s.begin, s.rows) +
               bytes_of(fixed_means, fixed_normals, fixed_scales, fixed_weights) +
               bytes_of(records, double_records, tau, position_tau, voter_strengths, voter_normals,
                        means, normals, sums, strengths, variability, strong_votes,
                        sorted_strengths, sorted_variability, left_out, tensors, vectors, flags);
    }
};

}  // namespace tvsgs::detail
