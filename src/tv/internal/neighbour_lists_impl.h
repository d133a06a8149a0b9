// How lists are made: tiles from the voters' ascending lists, then, for full lists, the receivers'
// lists from the tiles. The cost is linear in the edges, however many voters one receiver has, and
// every list comes out in order without being sorted.
#pragma once

#include <algorithm>

#include "core/parallel.h"
#include "tv/internal/neighbours.h"

namespace tvsgs::detail {

/// Tiles of 32 voters by a merge of their ascending lists; counts them, or writes them.
struct TileBody {
    static constexpr std::uint32_t kNone = ~0u;  // no rank is so large
    static constexpr std::size_t kScratch = 3 * EdgeTile::kVoters * sizeof(std::uint32_t);

    int voters, k;
    Span<const std::uint32_t> receivers;  // [voters, k]
    Span<int> counts;                     // [blocks]; empty: write
    Span<const std::int64_t> begin;       // [blocks + 1] of the blocks' tiles, from `used` on
    std::int64_t used;
    Span<EdgeTile> tiles;
    Span<std::uint32_t> receiver_block;
    std::int64_t* voter_begin;  // of the first block

    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int block, void* scratch) const {
        auto* heads = static_cast<std::uint32_t*>(scratch);  // of the 32 lists
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
        return voter < voters && next < static_cast<std::uint32_t>(k)
                   ? receivers[std::size_t(voter) * k + next]
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

/// Counts for a scan: a zero after them, so that it ends with the total.
struct CountTerm {
    Span<const int> counts;
    TVSGS_HD std::int64_t operator()(std::int64_t i) const {
        return i < counts.size() ? counts[static_cast<std::size_t>(i)] : 0;
    }
};

/// receiver_begin[b]: the first tile of the sorted ones with a block of b or later.
struct ReceiverBeginBody {
    Span<const std::uint32_t> sorted_blocks;
    Span<std::int64_t> receiver_begin;
    TVSGS_HD void operator()(int block) const {
        std::int64_t low = 0, high = static_cast<std::int64_t>(sorted_blocks.count);
        while (low < high) {
            const std::int64_t middle = (low + high) / 2;
            if (sorted_blocks[middle] < static_cast<std::uint32_t>(block))
                low = middle + 1;
            else
                high = middle;
        }
        receiver_begin[block] = low;
    }
};

/// The last entry of [0, size - 1) that is not above `value`; the very last one is above it.
template <class T>
TVSGS_HD int last_not_above(Span<const T> ascending, std::int64_t value) {
    int low = 0, high = ascending.size() - 1;
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        (std::int64_t(ascending[middle]) <= value ? low : high) = middle;
    }
    return low;
}

/// The block of voters that a tile is of: the last that begins at or before it.
struct VoterBlockBody {
    Span<const std::uint32_t> place;
    Span<const std::int64_t> voter_begin;
    Span<std::uint32_t> voter_block;
    TVSGS_HD void operator()(int t) const {
        voter_block[t] = static_cast<std::uint32_t>(last_not_above(voter_begin, place[t]));
    }
};

/// The process that a tile's receivers belong to.
struct OwnerBody {
    Span<const std::uint32_t> receiver_block;
    Span<const int> begins;  // of the processes' parts
    Span<std::uint32_t> owners;
    TVSGS_HD void operator()(int t) const {
        owners[t] = static_cast<std::uint32_t>(
            last_not_above(begins, std::int64_t{receiver_block[t]} * EdgeTile::kReceivers));
    }
};

/// Tiles in the order of their owners, with blocks of voters as in the whole, and of receivers as
/// the owner counts them.
struct SendTileBody {
    Span<const EdgeTile> tiles;
    Span<const std::uint32_t> receiver_block;
    Span<const std::int64_t> voter_begin;
    int first_voter_block;
    Span<const int> begins;
    Span<const std::uint32_t> order, owners;  // owners: sorted
    Span<EdgeTile> sent;
    Span<std::uint32_t> sent_receivers, sent_voters;
    TVSGS_HD void operator()(int t) const {
        const std::uint32_t from = order[t];
        sent[t] = tiles[from];
        sent_receivers[t] = receiver_block[from] -
                            static_cast<std::uint32_t>(begins[owners[t]] / EdgeTile::kReceivers);
        sent_voters[t] =
            static_cast<std::uint32_t>(first_voter_block + last_not_above(voter_begin, from));
    }
};

struct TakeBody {
    Span<const std::uint32_t> from, place;
    Span<std::uint32_t> to;
    TVSGS_HD void operator()(int t) const { to[t] = from[place[t]]; }
};

/// Numbers of voters of one block of receivers.
struct DegreeBody {
    CompactLists lists;
    Span<int> degrees;  // [own receivers]
    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int block, void*) const {
        int sums[EdgeTile::kReceivers] = {};
        for (std::int64_t t = lists.receiver_begin[block] + warp.lane();
             t < lists.receiver_begin[block + 1]; t += Warp::kLanes) {
            const EdgeTile tile = lists.received[lists.place[t]];
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
    TVSGS_HD void operator()(const Warp& warp, int i, void*) const {
        lists.write_voters(warp, lists.first_receiver + i, voters.data + begin[i]);
    }
};

/// Lists on the host, whatever form they are stored in: those that are here.
struct HostLists {
    std::vector<std::uint32_t> receivers, voters;
    std::vector<std::int64_t> begin;
};
HostLists unpacked(const CompactLists& lists, Part voters, int k, Part receivers);

template <class Device>
HostLists host_lists(const Neighbours<Device>& near) {
    if (near.storage == ListStorage::full)
        return {to_host(near.receivers), to_host(near.voters), to_host(near.begin)};
    const CompactLists there = near.compact_lists();
    const auto here = []<class T>(Span<const T> span) {  // no more than there are
        std::vector<T> values(span.count);
        copy(Device{}, span.data, Cpu{}, values.data(), span.count * sizeof(T));
        return values;
    };
    const auto tiles = here(there.tiles), received = here(there.received);
    const auto receiver_block = here(there.receiver_block), place = here(there.place),
               voter_block = here(there.voter_block);
    const auto voter_begin = here(there.voter_begin), receiver_begin = here(there.receiver_begin);
    const auto span = []<class T>(const std::vector<T>& values) {
        return Span<const T>{values.data(), values.size()};
    };
    const CompactLists lists{span(tiles),          span(receiver_block), span(voter_begin),
                             span(received),       span(place),          span(voter_block),
                             span(receiver_begin), there.first_voter,    there.first_receiver};
    return unpacked(lists, near.own_voters, near.k, near.own_receivers);
}

template <class... Buffers>
void free_memory(Buffers&... buffers) {
    ((buffers = Buffers{}), ...);
}

inline int blocks_of(int count, int size) {
    return (count + size - 1) / size;
}

/// Grows or shrinks without losing the first `used` elements.
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

/// Room for `size` elements and no more: the memory reported is the memory held.
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

/// Appends the tiles of the voters from `first`, a multiple of 32, on. Waits for the device, as the
/// memory needed depends on the lists.
template <class Device>
void add_tiles(NeighbourScratch<Device>& s,
               const Buffer<std::uint32_t, Device>& receivers,
               int first,
               int k,
               EdgeTiles<Device>& tiles) {
    const int voters = static_cast<int>(receivers.size() / std::size_t(k));
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

    const std::size_t needed = tiles.count + static_cast<std::size_t>(added);
    if (needed > tiles.tiles.size()) {
        // Other voters will need about as many.
        const double all = static_cast<double>(tiles.voter_begin.size() - 1);
        const double guess = 1.02 * static_cast<double>(needed) * all / (done + blocks);
        resize_tiles(tiles, done + blocks < all ? static_cast<std::size_t>(guess) : needed);
    }
    body.counts = {};
    body.begin = s.begin.span();
    body.used = static_cast<std::int64_t>(tiles.count);
    body.tiles = tiles.tiles.span();
    body.receiver_block = tiles.receiver_block.span();
    body.voter_begin = tiles.voter_begin.data() + done;
    for_each_warp(Device{}, blocks, TileBody::kScratch, body);
    tiles.count = needed;
}

/// Tiles of own voters go to the processes of their receivers; those of own receivers come, ordered
/// by voters, as rank after rank has the voters in order. Returns the voters' blocks of these.
template <class Device>
Buffer<std::uint32_t, Device> exchange_tiles(Communicator& peers,
                                             NeighbourScratch<Device>& s,
                                             Neighbours<Device>& out) {
    const EdgeTiles<Device>& tiles = out.tiles;
    const int count = static_cast<int>(tiles.count), ranks = peers.size();
    std::vector<int> begins;
    for (const std::size_t begin : part_begins(out.voters_count, ranks))
        begins.push_back(static_cast<int>(begin));
    const auto parts = to_device<Device>(begins);
    Buffer<std::uint32_t, Device> owners(tiles.count), sorted(tiles.count), order(tiles.count),
        spare, sent_receivers(tiles.count), sent_voters(tiles.count), voter_block;
    Buffer<EdgeTile, Device> sent(tiles.count);
    const Span<const std::uint32_t> receiver_block{tiles.receiver_block.data(), tiles.count};
    parallel_for(Device{}, count, OwnerBody{receiver_block, parts.span(), owners.span()});
    stable_order(std::as_const(owners).span(), ranks, sorted.span(), order.span(), spare, s.sort);
    Buffer<std::int64_t, Device> sent_begin(static_cast<std::size_t>(ranks) + 1);
    parallel_for(Device{}, ranks + 1,
                 ReceiverBeginBody{std::as_const(sorted).span(), sent_begin.span()});
    parallel_for(Device{}, count,
                 SendTileBody{{tiles.tiles.data(), tiles.count},
                              receiver_block,
                              tiles.voter_begin.span(),
                              out.own_voters.begin / EdgeTile::kVoters,
                              parts.span(),
                              std::as_const(order).span(),
                              std::as_const(sorted).span(),
                              sent.span(),
                              sent_receivers.span(),
                              sent_voters.span()});
    std::vector<std::size_t> to;
    for (const std::int64_t begin : to_host(sent_begin))
        to.push_back(static_cast<std::size_t>(begin));
    EdgeTiles<Device>& received = out.received;
    received.count = peers.all_to_all_v("lists of votes", sent, to, received.tiles).back();
    peers.all_to_all_v("lists of votes", sent_receivers, to, received.receiver_block);
    peers.all_to_all_v("lists of votes", sent_voters, to, voter_block);
    return voter_block;
}

/// The order by receivers. `scratch` grows to two numbers per tile. `voter_block`: of each tile,
/// where they are not those of tiles.voter_begin.
template <class Device>
void index_tiles(NeighbourScratch<Device>& s,
                 int receivers,
                 Buffer<std::uint32_t, Device>& scratch,
                 EdgeTiles<Device>& tiles,
                 const Buffer<std::uint32_t, Device>* block_of_voters = nullptr) {
    const int count = static_cast<int>(tiles.count);
    const int blocks = blocks_of(receivers, EdgeTile::kReceivers);
    if (tiles.tiles.size() > tiles.count + tiles.count / 8) resize_tiles(tiles, tiles.count);
    reserve(tiles.place, tiles.count), reserve(tiles.voter_block, tiles.count);
    tiles.receiver_begin.resize(std::size_t(blocks) + 1);
    const Span<std::uint32_t> place{tiles.place.data(), tiles.count};
    const Span<std::uint32_t> voter_block{tiles.voter_block.data(), tiles.count};
    stable_order({tiles.receiver_block.data(), tiles.count}, blocks, voter_block, place, scratch,
                 s.sort);
    parallel_for(Device{}, blocks + 1, ReceiverBeginBody{voter_block, tiles.receiver_begin.span()});
    if (block_of_voters == nullptr)
        parallel_for(Device{}, count, VoterBlockBody{place, tiles.voter_begin.span(), voter_block});
    else
        parallel_for(Device{}, count, TakeBody{block_of_voters->span(), place, voter_block});
}

/// Fills out.begin and out.voters from the tiles.
template <class Device>
void write_full_lists(NeighbourScratch<Device>& s, Neighbours<Device>& out) {
    const int receivers = out.own_receivers.size();
    s.cursors.resize(receivers);
    out.begin.resize(std::size_t(receivers) + 1);
    const CompactLists lists = out.compact_lists();
    for_each_warp(Device{}, blocks_of(receivers, EdgeTile::kReceivers), 0,
                  DegreeBody{lists, s.cursors.span()});
    exclusive_scan(CountTerm{s.cursors.span()}, out.begin, s.sort);
    std::int64_t edges = std::int64_t{out.voters_count} * out.k;  // how many of them come here?
    if (out.in_parts) copy(Device{}, out.begin.data() + receivers, Cpu{}, &edges, sizeof edges);
    out.voters.resize(static_cast<std::size_t>(edges));
    for_each_warp(Device{}, receivers, 0,
                  WriteVotersBody{lists, out.begin.span(), out.voters.span()});
}

inline constexpr int kChunkEdges = 8 << 20;  // 32 MB in the compact form

/// Calls search(first, count, rows) for consecutive voters, which writes their ascending lists,
/// and stores them in the form asked for. Of several processes each asks for its part of them.
template <class Device, class Search>
void store_lists(NeighbourScratch<Device>& s,
                 Neighbours<Device>& out,
                 const Search& search,
                 const StageDone& done = {},
                 int chunk_edges = kChunkEdges,
                 Communicator* peers = nullptr) {
    const auto finish = [&](const char* stage) {
        if (done) done(stage);
    };
    out.divide(peers);
    const Part own = out.own_voters;
    const bool full = out.storage == ListStorage::full;
    const int chunk =
        full ? own.size()
             : std::max(chunk_edges / out.k / EdgeTile::kVoters, 1) * EdgeTile::kVoters;
    Buffer<std::uint32_t, Device>& rows = full ? out.receivers : s.rows;
    begin_tiles(out.tiles, own.size());
    if (own.size() == 0) rows.resize(0);
    for (int first = own.begin; first < own.end; first += chunk) {
        const int count = std::min(chunk, own.end - first);
        rows.resize(std::size_t(count) * out.k);
        search(first, count, rows);
        finish("search");
        add_tiles(s, rows, first - own.begin, out.k, out.tiles);
        finish("reverse");
    }
    if (peers == nullptr) {
        index_tiles(s, out.usable, s.rows, out.tiles);
    } else {
        const auto block_of_voters = exchange_tiles(*peers, s, out);
        if (!full) resize_tiles(out.tiles, out.tiles.count);
        index_tiles(s, out.own_receivers.size(), s.rows, out.received, &block_of_voters);
    }
    if (full) {
        write_full_lists(s, out);
        free_memory(out.tiles, out.received, s.rows);
    }
    finish("reverse");
}

}  // namespace tvsgs::detail
