// Builds tiles from the voters' ascending lists, and for full lists then the receivers' lists from
// the tiles: linear in the number of edges, and ascending without a sort.
#pragma once

#include <algorithm>

#include "core/device/parallel.h"
#include "tv/internal/neighbours.h"

namespace tvsgs::detail {

/// Merges the ascending lists of 32 voters into tiles: counts them if `counts` is given, else
/// writes.
struct TileBody {
    static constexpr std::uint32_t kNone = ~0u;  // larger than any rank
    static constexpr std::size_t kScratch = 3 * EdgeTile::kVoters * sizeof(std::uint32_t);

    int voters, k;
    Span<const std::uint32_t> receivers;  // [voters, k]
    Span<int> counts;                     // [blocks]; empty: write
    Span<const std::int64_t> begin;  // [blocks + 1] first tile of each block, relative to `used`
    std::int64_t used;
    Span<EdgeTile> tiles;
    Span<std::uint32_t> receiver_block;
    std::int64_t* voter_begin;  // of the first block

    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int block, void* scratch) const {
        auto* heads = static_cast<std::uint32_t*>(scratch);  // next receivers of the 32 lists
        auto* taken = heads + EdgeTile::kVoters;
        auto* masks = taken + EdgeTile::kVoters;
        warp.for_lanes([&](int v) { taken[v] = 0, heads[v] = head(block, v, 0); });
        int count = 0;
        for (;; ++count) {
            const std::uint32_t to =
                warp.smallest32([&](int v) { return heads[v] / EdgeTile::kReceivers; });
            if (to == kNone / EdgeTile::kReceivers) break;
            warp.for_lanes([&](int v) {
                std::uint32_t rank = heads[v], mask = 0, next = taken[v];
                while (rank / EdgeTile::kReceivers == to) {
                    mask |= 1u << rank % EdgeTile::kReceivers;
                    rank = head(block, v, ++next);
                }
                heads[v] = rank, taken[v] = next, masks[v] = mask;
            });
            if (counts.empty()) write(warp, used + begin[block] + count, to, masks);
        }
        if (warp.lane() != 0) return;
        if (counts.empty())
            voter_begin[block + 1] = used + begin[block + 1];
        else
            counts[block] = count;
    }

private:
    TVSGS_HD std::uint32_t head(int block, int v, std::uint32_t next) const {
        const int voter = block * EdgeTile::kVoters + v;
        return voter < voters && next < std::uint32_t(k) ? receivers[std::size_t(voter) * k + next]
                                                         : kNone;
    }
    template <class Warp>
    TVSGS_HD void write(const Warp& warp,
                        std::int64_t tile,
                        std::uint32_t to,
                        const std::uint32_t* masks) const {
        for (int r = 0; r < EdgeTile::kReceivers; ++r) {
            const std::uint32_t row =
                warp.ballot32([&](int v) { return (masks[v] >> r & 1) != 0; });
            if (warp.lane() == r % Warp::kLanes) tiles[tile].voters[r] = row;
        }
        if (warp.lane() == 0) receiver_block[tile] = to;
    }
};

/// Counts followed by a zero, so that the exclusive scan ends with the total.
struct CountTerm {
    Span<const int> counts;
    TVSGS_HD std::int64_t operator()(std::int64_t i) const {
        return i < counts.size() ? counts[i] : 0;
    }
};

/// receiver_begin[b]: the first sorted tile whose block is at least b.
struct ReceiverBeginBody {
    Span<const std::uint32_t> sorted_blocks;
    Span<std::int64_t> receiver_begin;
    TVSGS_HD void operator()(int block) const {
        std::int64_t low = 0, high = std::int64_t(sorted_blocks.count);
        while (low < high) {
            const std::int64_t middle = (low + high) / 2;
            if (sorted_blocks[middle] < std::uint32_t(block))
                low = middle + 1;
            else
                high = middle;
        }
        receiver_begin[block] = low;
    }
};

/// Finds the voters' block of each tile: the last block that begins at or before the tile.
struct VoterBlockBody {
    Span<const std::uint32_t> place;
    Span<const std::int64_t> voter_begin;
    Span<std::uint32_t> voter_block;
    TVSGS_HD void operator()(int t) const {
        int low = 0, high = voter_begin.size() - 1;  // voter_begin[high] is above all places
        while (high - low > 1) {
            const int middle = (low + high) / 2;
            (voter_begin[middle] <= std::int64_t(place[t]) ? low : high) = middle;
        }
        voter_block[t] = std::uint32_t(low);
    }
};

/// Counts the voters of each receiver of one block.
struct DegreeBody {
    CompactLists lists;
    Span<int> degrees;  // [usable]
    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int block, void*) const {
        int sums[EdgeTile::kReceivers] = {};
        for (std::int64_t t = lists.receiver_begin[block] + warp.lane();
             t < lists.receiver_begin[block + 1]; t += Warp::kLanes) {
            const EdgeTile tile = lists.tiles[lists.place[t]];
            for (int r = 0; r < EdgeTile::kReceivers; ++r) sums[r] += std::popcount(tile.voters[r]);
        }
        for (int r = 0; r < EdgeTile::kReceivers; ++r) {
            const int sum = warp.sum(sums[r]), rank = block * EdgeTile::kReceivers + r;
            if (warp.lane() == 0 && rank < degrees.size()) degrees[rank] = sum;
        }
    }
};

struct WriteVotersBody {
    CompactLists lists;
    Span<const std::int64_t> begin;
    Span<std::uint32_t> voters;
    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int rank, void*) const {
        lists.write_voters(warp, rank, voters.data + begin[rank]);
    }
};

/// The neighbour lists on the host, in full form.
struct HostLists {
    std::vector<std::uint32_t> receivers, voters;
    std::vector<std::int64_t> begin;
};
HostLists unpacked(const CompactLists& lists, int voters, int k, int usable);

template <class Device>
HostLists host_lists(const Neighbours<Device>& near) {
    if (near.storage == ListStorage::full)
        return {to_host(near.receivers), to_host(near.voters), to_host(near.begin)};
    const CompactLists there = near.compact_lists();
    const auto here = []<class T>(Span<const T> span) {
        std::vector<T> values(span.count);
        copy(Device{}, span.data, Cpu{}, values.data(), span.count * sizeof(T));
        return values;
    };
    const auto tiles = here(there.tiles);
    const auto receiver_block = here(there.receiver_block), place = here(there.place),
               voter_block = here(there.voter_block);
    const auto voter_begin = here(there.voter_begin), receiver_begin = here(there.receiver_begin);
    const auto span = []<class T>(const std::vector<T>& values) {
        return Span<const T>{values.data(), values.size()};
    };
    const CompactLists lists{span(tiles), span(receiver_block), span(voter_begin),
                             span(place), span(voter_block),    span(receiver_begin)};
    return unpacked(lists, near.voters_count, near.k, near.usable);
}

template <class... Buffers>
void free_memory(Buffers&... buffers) {
    ((buffers = Buffers{}), ...);
}

inline int blocks_of(int count, int size) {
    return (count + size - 1) / size;
}

template <class T, class Device>
void resize_keeping(Buffer<T, Device>& buffer, std::size_t used, std::size_t size) {
    Buffer<T, Device> other(size);
    copy(Device{}, buffer.data(), Device{}, other.data(), used * sizeof(T));
    buffer.swap(other);
}
template <class Device>
void resize_tiles(EdgeTiles<Device>& tiles, std::size_t size) {
    resize_keeping(tiles.tiles, tiles.count, size);
    resize_keeping(tiles.receiver_block, tiles.count, size);
}

/// Allocates exactly `size` elements, so that the memory reported is the memory held.
template <class T, class Device>
void reserve(Buffer<T, Device>& buffer, std::size_t size) {
    if (size <= buffer.size()) return;
    free_memory(buffer);
    buffer.resize(size);
}

template <class Device>
void begin_tiles(EdgeTiles<Device>& tiles, int voters) {
    tiles.count = 0;
    tiles.voter_begin.resize(std::size_t(blocks_of(voters, EdgeTile::kVoters)) + 1);
    tiles.voter_begin.fill_zero();
}

/// Appends the tiles of the voters from `first` (a multiple of 32) on. Waits for the device.
template <class Device>
void add_tiles(NeighbourScratch<Device>& s,
               const Buffer<std::uint32_t, Device>& receivers,
               int first,
               int k,
               EdgeTiles<Device>& tiles) {
    const int voters = int(receivers.size() / std::size_t(k));
    const int blocks = blocks_of(voters, EdgeTile::kVoters);
    const int done = first / EdgeTile::kVoters;
    s.cursors.resize(blocks);
    s.begin.resize(std::size_t(blocks) + 1);
    TileBody body{};
    body.voters = voters, body.k = k, body.receivers = receivers.span();
    body.counts = s.cursors.span();
    for_each_warp(Device{}, blocks, TileBody::kScratch, body);
    exclusive_scan(CountTerm{s.cursors.span()}, s.begin, s.sort);
    std::int64_t added = 0;
    copy(Device{}, s.begin.data() + blocks, Cpu{}, &added, sizeof(added));

    const std::size_t needed = tiles.count + std::size_t(added);
    if (needed > tiles.tiles.size()) {
        // The remaining voters will need about as many tiles per voter.
        const double all = double(tiles.voter_begin.size() - 1);
        const double guess = 1.02 * double(needed) * all / (done + blocks);
        resize_tiles(tiles, done + blocks < all ? std::size_t(guess) : needed);
    }
    body.counts = {};
    body.begin = s.begin.span();
    body.used = std::int64_t(tiles.count);
    body.tiles = tiles.tiles.span();
    body.receiver_block = tiles.receiver_block.span();
    body.voter_begin = tiles.voter_begin.data() + done;
    for_each_warp(Device{}, blocks, TileBody::kScratch, body);
    tiles.count = needed;
}

/// Orders the tiles by receivers. s.rows grows to two numbers per tile.
template <class Device>
void index_tiles(NeighbourScratch<Device>& s, Neighbours<Device>& out) {
    EdgeTiles<Device>& tiles = out.tiles;
    const int count = int(tiles.count);
    const int blocks = blocks_of(out.usable, EdgeTile::kReceivers);
    if (tiles.tiles.size() > tiles.count + tiles.count / 8) resize_tiles(tiles, tiles.count);
    reserve(tiles.place, tiles.count), reserve(tiles.voter_block, tiles.count);
    tiles.receiver_begin.resize(std::size_t(blocks) + 1);
    const Span<std::uint32_t> place{tiles.place.data(), tiles.count};
    const Span<std::uint32_t> voter_block{tiles.voter_block.data(), tiles.count};
    stable_order({tiles.receiver_block.data(), tiles.count}, blocks, voter_block, place, s.rows,
                 s.sort);
    parallel_for(Device{}, blocks + 1, ReceiverBeginBody{voter_block, tiles.receiver_begin.span()});
    parallel_for(Device{}, count, VoterBlockBody{place, tiles.voter_begin.span(), voter_block});
}

/// Fills out.begin and out.voters from the tiles.
template <class Device>
void write_full_lists(NeighbourScratch<Device>& s, Neighbours<Device>& out) {
    s.cursors.resize(out.usable);
    out.begin.resize(std::size_t(out.usable) + 1);
    out.voters.resize(std::size_t(out.voters_count) * out.k);
    const CompactLists lists = out.compact_lists();
    for_each_warp(Device{}, blocks_of(out.usable, EdgeTile::kReceivers), 0,
                  DegreeBody{lists, s.cursors.span()});
    exclusive_scan(CountTerm{s.cursors.span()}, out.begin, s.sort);
    for_each_warp(Device{}, out.usable, 0,
                  WriteVotersBody{lists, out.begin.span(), out.voters.span()});
}

/// Stores the lists in the form out.storage. search(first, count, rows) writes the ascending lists
/// of a chunk of voters.
template <class Device, class Search>
void store_lists(NeighbourScratch<Device>& s,
                 Neighbours<Device>& out,
                 const Search& search,
                 const StageDone& done = ignore_stage,
                 int chunk_edges = 8 << 20) {  // 32 MB in the compact form
    const bool full = out.storage == ListStorage::full;
    const int chunk =
        full ? out.voters_count
             : std::max(chunk_edges / out.k / EdgeTile::kVoters, 1) * EdgeTile::kVoters;
    Buffer<std::uint32_t, Device>& rows = full ? out.receivers : s.rows;
    begin_tiles(out.tiles, out.voters_count);
    for (int first = 0; first < out.voters_count; first += chunk) {
        const int count = std::min(chunk, out.voters_count - first);
        rows.resize(std::size_t(count) * out.k);
        search(first, count, rows);
        done("search");
        add_tiles(s, rows, first, out.k, out.tiles);
        done("reverse");
    }
    index_tiles(s, out);
    if (full) {
        write_full_lists(s, out);
        free_memory(out.tiles, s.rows);
    }
    done("reverse");
}

}  // namespace tvsgs::detail
