// What both twins of find_neighbours() share: only the sorts, the loops and the reversal of the
// lists differ.
#pragma once

#include <limits>

#include "core/parallel.h"
#include "tv/neighbours.h"

namespace tvsgs::detail {

inline constexpr float kLast =
    std::numeric_limits<float>::infinity();  // sorts unusable splats to the end

struct TraceBody {
    SplatSpans splats;
    Span<float> traces;

    TVSGS_HD void operator()(int i) const {
        const Vec3f s = splats.scales<float>(i);
        traces[i] = splats.usable(i) ? dot(s, s) : kLast;
    }
};

struct UsableTerm {
    Span<const float> traces;
    TVSGS_HD double operator()(int i) const { return traces[i] < kLast ? 1 : 0; }
};

struct CoordinateBody {
    SplatSpans splats;
    int axis;
    Span<float> values;
    TVSGS_HD void operator()(int i) const {
        values[i] = splats.usable(i) ? splats.means[i][axis] : kLast;
    }
};

/// Copies sorted values at two ranks; parallel_for over one element.
struct PickBody {
    Span<const float> sorted;
    int low, high;
    float* out;
    TVSGS_HD void operator()(int) const { out[0] = sorted[low], out[1] = sorted[high]; }
};

struct CodeBody {
    SplatSpans splats;
    const float* quantiles;  // low and high of each axis
    bool high_word;
    Span<const std::uint32_t> order;
    Span<std::uint64_t> codes;

    TVSGS_HD void operator()(int slot) const {
        const int i = static_cast<int>(order[slot]);
        double extent = 0;
        for (int axis = 0; axis < 3; ++axis) {
            const double edge = double(quantiles[2 * axis + 1]) - double(quantiles[2 * axis]);
            extent = edge > extent ? edge : extent;
        }
        const MortonCode code =
            morton_code(splats.means[i], {quantiles[0], quantiles[2], quantiles[4]}, extent);
        codes[slot] = !splats.usable(i) ? ~0ull : high_word ? code.high : code.low;
    }
};

struct IotaBody {
    Span<std::uint32_t> values;
    TVSGS_HD void operator()(int i) const { values[i] = static_cast<std::uint32_t>(i); }
};

struct TreePointBody {
    SplatSpans splats;
    Span<const std::uint32_t> order;
    Span<TreePoint> points;
    TVSGS_HD void operator()(int slot) const {
        points[slot] = {splats.means[order[slot]], order[slot]};
    }
};

template <class Real>
struct QueryBody {
    SplatSpans splats;
    WhitenRule rule;
    const double* noise;
    MortonTree tree;
    int candidates, k, capacity;
    Span<std::uint32_t> receivers;

    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int slot, void* scratch) const {
        auto* keys = static_cast<std::uint64_t*>(scratch);
        const int found = NearestSearch<Warp>(warp, tree, keys, capacity, candidates).run(slot);
        const int voter = static_cast<int>(tree.points[slot].index);
        const Mat3<Real> W = whitened_from_world(splats.whitening<Real>(voter, rule, *noise));
        const Vec3<Real> mean = vec_cast<Real>(splats.means[voter]);
        for (int r = warp.lane(); r < found; r += Warp::kLanes) {
            const std::uint32_t receiver = key_index(keys[r]);
            const Vec3<Real> d = W * (vec_cast<Real>(splats.means[receiver]) - mean);
            keys[r] = distance_key(static_cast<float>(dot(d, d)), receiver);
        }
        warp.sync();
        warp.smallest_first(keys, found, k);
        for (int r = warp.lane(); r < k; r += Warp::kLanes)
            receivers[std::size_t(voter) * k + r] = key_index(keys[r]);
    }
};

/// Fills out.begin and out.voters from out.receivers; a splat with traces[i] = kLast has no list.
void reverse_lists(Span<const TreePoint> points,
                   NeighbourScratch<Cpu>& scratch,
                   Neighbours<Cpu>& out);
void reverse_lists(Span<const TreePoint> points,
                   NeighbourScratch<Cuda>& scratch,
                   Neighbours<Cuda>& out);

template <class Device>
void count_usable(const SplatSpans& splats, NeighbourScratch<Device>& s, Neighbours<Device>& out) {
    const int count = splats.size();
    s.values.resize(count);
    s.sums.resize(kSumBlocks + 1);
    s.sums.fill_zero();
    parallel_for(Device{}, count, TraceBody{splats, s.values.span()});
    add_sum(Device{}, count, UsableTerm{s.values.span()}, 1,
            Span<double>{s.sums.data(), kSumBlocks}, s.sums.data() + kSumBlocks);
    // The one wait of a search: the shape of everything that follows depends on this number.
    out.usable = static_cast<int>(to_host(s.sums).back());
    if (out.usable < 2) return;
    sort(s.values, s.sort);
    s.stats.resize(8);
    parallel_for(Device{}, 1,
                 PickBody{s.values.span(), out.usable / 2, out.usable - 1, s.stats.data()});
    const std::vector<float> stats = to_host(s.stats);
    out.median_trace = stats[0], out.largest_trace = stats[1];
}

/// Morton order of the usable splats, outliers clamped to the box of the 0.1% and 99.9% quantiles.
template <class Device>
void sort_points(const SplatSpans& splats, int usable, NeighbourScratch<Device>& s) {
    const int count = splats.size();
    const int low = usable / 1000, high = usable - 1 - low;
    float* quantiles = s.stats.data() + 2;
    for (int axis = 0; axis < 3; ++axis) {
        parallel_for(Device{}, count, CoordinateBody{splats, axis, s.values.span()});
        sort(s.values, s.sort);
        parallel_for(Device{}, 1, PickBody{s.values.span(), low, high, quantiles + 2 * axis});
    }
    s.codes.resize(count);
    s.order.resize(count);
    parallel_for(Device{}, count, IotaBody{s.order.span()});
    for (const bool high_word : {false, true}) {  // least significant first: the sort is stable
        parallel_for(Device{}, count,
                     CodeBody{splats, quantiles, high_word, s.order.span(), s.codes.span()});
        sort_by_key(s.codes, s.order, s.sort);
    }
    s.points.resize(usable);
    parallel_for(Device{}, usable, TreePointBody{splats, s.order.span(), s.points.span()});
}

template <class Device>
void find_neighbours(const SplatSpans& splats,
                     int k,
                     const WhitenRule& rule,
                     const double* noise,
                     NeighbourScratch<Device>& s,
                     Neighbours<Device>& out) {
    out.k = 0;
    count_usable(splats, s, out);
    if (out.usable < 2) return;
    sort_points(splats, out.usable, s);

    MortonTree tree;
    s.nodes.resize(set_tree_shape(tree, out.usable));
    tree.points = s.points.span();
    tree.nodes = s.nodes.span();
    for (int level = 0; level < tree.levels; ++level)
        parallel_for(Device{}, tree.level_size[level], TreeNodeBody{tree, level});

    const int candidates = std::min(2 * k, out.usable - 1), capacity = search_capacity(candidates);
    out.k = std::min(k, candidates);
    out.receivers.resize(std::size_t(splats.size()) * out.k);
    out.receivers.fill_zero();  // the rows of splats that are left out are read, though never used
    for_each_warp(Device{}, out.usable, capacity * sizeof(std::uint64_t),
                  QueryBody<VoteReal<Device>>{splats, rule, noise, tree, candidates, out.k,
                                              capacity, out.receivers.span()});

    out.begin.resize(std::size_t(splats.size()) + 1);
    out.voters.resize(std::size_t(out.usable) * out.k);
    reverse_lists(s.points.span(), s, out);
}

}  // namespace tvsgs::detail
