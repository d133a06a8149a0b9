// Who votes for whom.  [docs/method/voting.md#neighbours]
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>

#include "comm/communicator.h"
#include "core/buffer.h"
#include "tv/internal/morton_tree.h"
#include "tv/internal/neighbour_lists.h"
#include "tv/internal/splats.h"
#include "tv/internal/warp.h"

namespace tvsgs {

/// Lists of one search; they hold until the number or the order of the splats changes. They name
/// usable splats by rank, their place in Morton order: what is near in space is near in memory.
/// Voters below `usable` are ranks; the fixed voters come after them.
template <class Device>
struct Neighbours {
    int k = 0;       // receivers of each voter: min(asked for, usable splats - 1)
    int usable = 0;  // splats that take part
    int voters_count = 0;
    ListStorage storage = ListStorage::full;
    Buffer<TreePoint, Device> points;  // [usable] the splats by rank, as searched
    /// Whose lists are here; of one process all of them. A process that has the list of receivers
    /// of a splat also has that of its voters.
    Part own_voters, own_receivers;
    EdgeTiles<Device> tiles;     // the lists in the compact form; of full lists a step
    EdgeTiles<Device> received;  // of several processes: the tiles of own receivers, of all voters
    bool in_parts = false;
    // Of full lists only.
    Buffer<std::uint32_t, Device> receivers;  // [own voters, k] ranks, ascending for each voter
    Buffer<std::int64_t, Device> begin;       // [own receivers + 1] where their voters begin
    Buffer<std::uint32_t, Device> voters;     // ascending for each receiver
    float median_trace = 0;                   // of the usable splats' covariances
    double noise = 0;                         // that of the query, where it names one
    std::int64_t candidates = 0, leaves = 0;  // looked at; only counted on request

    FullLists full_lists() const {
        return {k,
                receivers.span(),
                begin.span(),
                voters.span(),
                own_voters.begin,
                own_receivers.begin};
    }
    CompactLists compact_lists() const {
        return tvsgs::compact_lists(tiles, in_parts ? received : tiles, own_voters.begin,
                                    own_receivers.begin);
    }
    /// Deals voters and receivers to the processes.
    void divide(const Communicator* peers) {
        in_parts = peers != nullptr;
        own_voters = own_part(peers, voters_count);
        own_receivers = {std::min(own_voters.begin, usable), std::min(own_voters.end, usable)};
    }
};

/// Scratch memory of the search, kept between calls.
template <class Device>
struct NeighbourScratch {
    SortScratch<Device> sort;
    Buffer<float, Device> values;  // [N] sorted: traces, then coordinates of one axis
    Buffer<float, Device> stats;   // median trace and noise, then quantiles
    Buffer<double, Device> sums;   // partial sums and their total
    Buffer<std::uint64_t, Device> codes;
    Buffer<std::uint32_t, Device> order;
    Buffer<TreeNode, Device> nodes;
    Buffer<int, Device> cursors;
    Buffer<std::int64_t, Device> begin;
    Buffer<std::uint32_t, Device> rows;  // receivers of some voters, and what sorts the tiles
    Buffer<SearchCounts, Device> counts;
};

/// What a search is for.
struct NeighbourQuery {
    SplatSpans splats;
    FixedVoterSpans fixed;
    int k = 0;
    WhitenRule rule;
    const double* noise = nullptr;  // global regulariser of the whitening, on the device
    bool count_work = false;
    ListStorage storage = ListStorage::full;
    Communicator* peers = nullptr;  // each searches for its part of the voters
};

/// Called with the name of each stage when it is done: "keys", "tree", "search", "reverse".
using StageDone = std::function<void(const char*)>;

/// For each voter the 2k nearest usable splats but itself, and among them the k nearest in its
/// whitened space; ties by rank. Exact for all inputs; splats with values that are not finite are
/// left out. With fewer than two usable splats k is 0.
void find_neighbours(const NeighbourQuery& query,
                     NeighbourScratch<Cpu>& scratch,
                     Neighbours<Cpu>& out,
                     const StageDone& done = {});
void find_neighbours(const NeighbourQuery& query,
                     NeighbourScratch<Cuda>& scratch,
                     Neighbours<Cuda>& out,
                     const StageDone& done = {});

}  // namespace tvsgs
