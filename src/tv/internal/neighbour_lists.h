// Two storage forms of the neighbour lists and their readers. Both forms hold the same edges in the
// same order and give them to the same lanes, so sums agree bit for bit.
#pragma once

#include <bit>
#include <cstdint>

#include "core/device/buffer.h"

namespace tvsgs {

/// full: one number per edge and direction. compact: about one byte per edge for both directions.
enum class ListStorage { full, compact };

/// The full form.
struct FullLists {
    int k;                                // receivers of each voter
    Span<const std::uint32_t> receivers;  // [voters, k] ascending for each voter
    Span<const std::int64_t> begin;       // [usable + 1] index of the first voter of receiver i
    Span<const std::uint32_t> voters;     // ascending for each receiver

    /// Scratch memory per warp for receivers_of().
    static std::size_t scratch_bytes(int /*k*/) { return 0; }

    /// The k receivers of the voter.
    template <class Warp>
    TVSGS_HD const std::uint32_t* receivers_of(const Warp&, int voter, void* /*scratch*/) const {
        return receivers.data + std::size_t(voter) * k;
    }
    /// Calls action(voter) for the voters of the splat at `rank`. Voter number e goes to the lanes
    /// whose number equals e modulo kStride.
    template <int kStride, class Warp, class Action>
    TVSGS_HD void for_each_voter(const Warp& warp, int rank, const Action& action) const {
        const std::int64_t end = begin[rank + 1];
        for (std::int64_t e = begin[rank] + warp.lane() % kStride; e < end; e += kStride)
            action(voters[e]);
    }
};

/// Votes of 32 voters for 8 receivers, one bit each: one sector of memory. Ranks follow the Morton
/// order, so few tiles hold all edges: about 75 for 32 voters with 100 votes each on a surface.
/// [docs/method/voting.md#lists-of-voters]
struct alignas(32) EdgeTile {
    static constexpr int kVoters = 32, kReceivers = 8;
    std::uint32_t voters[kReceivers];  // bit v of word r: voter v votes for receiver r
};

/// Writes first + i to `out` for each bit i of the masks, lane by lane; returns their number.
template <class Warp>
TVSGS_HD int write_members(const Warp& warp,
                           std::uint32_t mask,
                           std::uint32_t first,
                           std::uint32_t* out) {
    const int mine = std::popcount(mask), before = warp.sum_before(mine);
    out += before;
    for (; mask != 0; mask &= mask - 1) *out++ = first + std::uint32_t(Warp::lowest_bit(mask));
    return warp.from_lane(before + mine, Warp::kLanes - 1);
}

/// Position of the n-th set bit, counted from 0.
TVSGS_HD inline int place_of_bit(std::uint32_t mask, int n) {
    int place = 0;
    for (int half = 16; half > 0; half /= 2) {
        const int below = std::popcount(mask & ((1u << half) - 1));
        const bool above = n >= below;
        n -= above ? below : 0;
        mask >>= above ? half : 0;
        place += above ? half : 0;
    }
    return place;
}

/// The compact form.
struct CompactLists {
    Span<const EdgeTile> tiles;  // ordered by block of voters, then by block of receivers
    Span<const std::uint32_t> receiver_block;  // of each tile
    Span<const std::int64_t> voter_begin;      // [blocks of voters + 1]
    // The same tiles ordered by block of receivers, then by block of voters.
    Span<const std::uint32_t> place;  // index into `tiles`
    Span<const std::uint32_t> voter_block;
    Span<const std::int64_t> receiver_begin;  // [blocks of receivers + 1]

    static std::size_t scratch_bytes(int k) { return std::size_t(k) * sizeof(std::uint32_t); }

    template <class Warp>
    TVSGS_HD const std::uint32_t* receivers_of(const Warp& warp, int voter, void* scratch) const {
        auto* list = static_cast<std::uint32_t*>(scratch);
        const int block = voter / EdgeTile::kVoters, bit = voter % EdgeTile::kVoters;
        const std::int64_t end = voter_begin[block + 1];
        int count = 0;
        for (std::int64_t first = voter_begin[block]; first < end; first += Warp::kLanes) {
            const std::int64_t t = first + warp.lane();
            std::uint32_t mask = 0, receiver = 0;
            if (t < end) {
                const EdgeTile tile = tiles[t];
                for (int r = 0; r < EdgeTile::kReceivers; ++r)
                    mask |= (tile.voters[r] >> bit & 1) << r;
                receiver = receiver_block[t] * EdgeTile::kReceivers;
            }
            count += write_members(warp, mask, receiver, list + count);
        }
        warp.sync();
        return list;
    }

    template <int kStride, class Warp, class Action>
    TVSGS_HD void for_each_voter(const Warp& warp, int rank, const Action& action) const {
        const std::int64_t end = receiver_begin[rank / EdgeTile::kReceivers + 1];
        std::int64_t first = receiver_begin[rank / EdgeTile::kReceivers];
        if constexpr (Warp::kLanes == 1) {
            for (; first < end; ++first)
                for (std::uint32_t mask = voters_in(first, rank); mask != 0; mask &= mask - 1)
                    action(first_voter(first) + std::uint32_t(Warp::lowest_bit(mask)));
        } else {
            // Each lane reads one tile; lane e % 32 gets voter e of these 32 tiles. If fewer than
            // 32 remain, they stay in their lanes until the next tiles.
            std::uint32_t mine = 0;
            int found = 0;
            for (bool last = false; !last;) {
                const std::int64_t t = first + warp.lane();
                const std::uint32_t mask = t < end ? voters_in(t, rank) : 0;
                const std::uint32_t base = t < end ? first_voter(t) : 0;
                const int count = std::popcount(mask), before = warp.sum_before(count);
                const int known = found;
                found += warp.from_lane(before + count, Warp::kLanes - 1);
                first += Warp::kLanes;
                last = first >= end;
                for (int e = known / Warp::kLanes * Warp::kLanes; e < found; e += Warp::kLanes) {
                    const int own = e + warp.lane() - known;
                    const std::uint32_t candidate = member(warp, mask, base, before, own);
                    if (own >= 0) mine = candidate;
                    if (e + Warp::kLanes > found && !last) continue;
                    for (int part = 0; part < Warp::kLanes; part += kStride) {
                        const int source = part + warp.lane() % kStride;
                        const std::uint32_t voter =
                            kStride == Warp::kLanes ? mine : warp.from_lane(mine, source);
                        if (e + source < found) action(voter);
                    }
                }
            }
        }
    }

    /// Writes the voters of the splat at `rank` to `out`. The whole warp must call it.
    template <class Warp>
    TVSGS_HD void write_voters(const Warp& warp, int rank, std::uint32_t* out) const {
        const std::int64_t end = receiver_begin[rank / EdgeTile::kReceivers + 1];
        for (std::int64_t first = receiver_begin[rank / EdgeTile::kReceivers]; first < end;
             first += Warp::kLanes) {
            const std::int64_t t = first + warp.lane();
            out += write_members(warp, t < end ? voters_in(t, rank) : 0,
                                 t < end ? first_voter(t) : 0, out);
        }
    }

    TVSGS_HD std::uint32_t voters_in(std::int64_t t, int rank) const {
        return tiles[place[t]].voters[rank % EdgeTile::kReceivers];
    }

private:
    TVSGS_HD std::uint32_t first_voter(std::int64_t t) const {
        return voter_block[t] * EdgeTile::kVoters;
    }
    /// Voter number e of all lanes' masks; `before` of them are in lower lanes.
    template <class Warp>
    TVSGS_HD static std::uint32_t member(
        const Warp& warp, std::uint32_t mask, std::uint32_t base, int before, int e) {
        int lane = 0;  // last lane with before <= e; an empty mask precedes the mask after it
        for (int step = Warp::kLanes / 2; step > 0; step /= 2)
            if (warp.from_lane(before, lane + step) <= e) lane += step;
        const int n = e - warp.from_lane(before, lane);
        return warp.from_lane(base, lane) +
               std::uint32_t(place_of_bit(warp.from_lane(mask, lane), n));
    }
};

/// Owner of the tiles. The buffers may be longer than `count`, which is final when all tiles exist.
template <class Device>
struct EdgeTiles {
    std::size_t count = 0;
    Buffer<EdgeTile, Device> tiles;
    Buffer<std::uint32_t, Device> receiver_block, place, voter_block;
    Buffer<std::int64_t, Device> voter_begin, receiver_begin;
};

}  // namespace tvsgs
