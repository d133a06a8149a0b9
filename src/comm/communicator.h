// What the processes of one training tell each other.
//
// Libraries move bytes and our own loops add: a sum of floats that a library makes depends on how
// many processes there are. So parts are gathered in the order of the ranks, and added in that
// order by whoever keeps the sum.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <type_traits>
#include <vector>

#include "core/buffer.h"
#include "core/error.h"
#include "core/part.h"

namespace tvsgs {

/// The processes of a training, one for each device. All make the same calls in the same order; a
/// call that differs on one of them is found out, but in deal_known(), and is an
/// Error(ExitCode::peer), as is waiting for longer than the limit. A null pointer stands for a
/// process by itself.
class Communicator {
public:
    virtual ~Communicator() = default;
    virtual int rank() const = 0;  // 0 <= rank < size
    virtual int size() const = 0;
    virtual int local_rank() const = 0;  // among those of this machine
    virtual int local_size() const = 0;

    /// Where the parts of a gather lie: part r is [begin[r], begin[r + 1]), bytes.
    using Begins = std::vector<std::size_t>;

    /// `all` <- the parts of all ranks, from rank 0 on, on each of them. Parts may have different
    /// sizes, and be empty. `what` names the call for messages.
    Begins all_gather_v(const char* what,
                        const void* part,
                        std::size_t bytes,
                        std::vector<std::byte>& all);

    /// The same from and to where `Device` says; straight from its memory where the backend can.
    template <class T, class Device>
    std::vector<std::size_t> all_gather_v(const char* what,
                                          const Buffer<T, Device>& part,
                                          std::size_t count,
                                          Buffer<T, Device>& all);

    /// Planes of as many elements each, one after the other, of `width` bytes an element.
    struct Planes {
        void* data;
        std::size_t width;
        int count = 1;
    };
    /// Each has written its part of every plane where it belongs; the others' parts <- theirs.
    /// `begins`: of the parts, elements. All of it is one call. `meanwhile` gives the device work
    /// on other arrays, which it does while the parts are on their way.
    template <class Device>
    void share(
        const char* what,
        Device,
        const std::vector<Planes>& arrays,
        const std::vector<std::size_t>& begins,
        const std::function<void()>& meanwhile = [] {});
    template <class T, class Device>
    void share(const char* what, Device, T* data, const std::vector<std::size_t>& begins) {
        share(what, Device{}, std::vector<Planes>{{data, sizeof(T)}}, begins);
    }

    /// parts[begins[r], begins[r + 1]) goes to rank r; `got` <- what has come from all, from rank 0
    /// on. Returns where each one's begins.
    template <class T, class Device>
    std::vector<std::size_t> all_to_all_v(const char* what,
                                          const Buffer<T, Device>& parts,
                                          const std::vector<std::size_t>& begins,
                                          Buffer<T, Device>& got);

    /// The same where all know what each sends to whom: parts[to[r], to[r + 1]) goes to rank r, and
    /// got[from[r], from[r + 1]) comes from it. Nothing is checked.
    template <class T, class Device>
    void deal_known(const char* what,
                    const Buffer<T, Device>& parts,
                    const std::vector<std::size_t>& to,
                    Buffer<T, Device>& got,
                    const std::vector<std::size_t>& from);

    /// `data` <- that of `root`.
    void broadcast(const char* what, void* data, std::size_t bytes, int root);
    std::string broadcast(const char* what, const std::string& text, int root);

    enum class Reduce { sum, min, max };
    /// values <- their sums, least or largest over the ranks. All have as many.
    void all_reduce(const char* what, Reduce reduce, std::vector<std::int64_t>& values);

    /// Returns when all ranks have called it. The limit does not hold: one of them may be busy for
    /// all.
    void wait_for_all(const char* what);

    /// Ends this process with that exit code, and with it, at once or when they notice, the others.
    [[noreturn]] virtual void abort(int code) = 0;

    /// The last call of a training that has ended well.
    virtual void leave() = 0;

    /// For messages: where the training is.
    void set_iteration(int iteration) { iteration_ = iteration; }

    /// Says whether this process is asked to end; then it waits ten seconds and no longer.
    void set_asked_to_end(std::function<bool()> asked) { asked_to_end_ = std::move(asked); }

    /// How long a call may wait, seconds.
    void set_limit(double seconds) { limit_ = seconds; }

protected:
    /// What a backend has to do: all[begins[r], begins[r + 1]) <- part of rank r. The own part may
    /// lie there already. `calm`: long waits are to be expected, and need not be noticed at once
    /// when they end. Calls keep_waiting() again and again.
    virtual void gather(const void* part, const Begins& begins, void* all, bool calm) = 0;

    /// And: got[from[r], from[r + 1]) <- parts[to[own rank], to[own rank + 1]) of rank r, of which
    /// `to` is that rank's own.
    virtual void deal(const void* parts, const Begins& to, void* got, const Begins& from) = 0;

    /// The same from and to memory of the GPU, for backends that reach it; several at once.
    struct Gather {
        const void* part;
        Begins begins;
        void* all;
    };
    virtual bool reaches_gpu() const { return false; }
    virtual void gather_on_gpu(const std::vector<Gather>& gathers,
                               const std::function<void()>& meanwhile);
    virtual void deal_on_gpu(const void* parts, const Begins& to, void* got, const Begins& from);

    /// Throws Error(ExitCode::peer) when that has taken too long.
    void keep_waiting(double seconds);

private:
    struct Letter;
    /// What each rank says of its next call, `part` with it where there is room. Checks that the
    /// ranks are in the same call.
    std::vector<Letter> exchange_letters(const char* what,
                                         const void* part,
                                         std::size_t bytes,
                                         bool calm);
    /// Sizes of the parts.
    Begins exchange_sizes(const char* what, std::size_t bytes);
    /// Where the parts begin that come from each, when those for each begin at `to`.
    Begins exchange_places(const char* what, const Begins& to);
    /// Throws Error(ExitCode::peer) unless the ranks have parts of the same sizes in mind.
    void require_same_parts(const char* what, const Begins& said, const Begins& expected) const;

    std::uint64_t calls_ = 0;
    const char* what_ = "";
    bool unlimited_ = false;
    int iteration_ = 0;
    double limit_ = 300, asked_at_ = -1;
    std::function<bool()> asked_to_end_;
};

inline int rank_of(const Communicator* peers) {
    return peers == nullptr ? 0 : peers->rank();
}
inline int size_of(const Communicator* peers) {
    return peers == nullptr ? 1 : peers->size();
}

template <class T, class Device>
std::vector<std::size_t> Communicator::all_gather_v(const char* what,
                                                    const Buffer<T, Device>& part,
                                                    std::size_t count,
                                                    Buffer<T, Device>& all) {
    const Begins begins = exchange_sizes(what, count * sizeof(T));
    all.resize(begins.back() / sizeof(T));
    std::vector<std::size_t> elements;
    for (const std::size_t begin : begins) elements.push_back(begin / sizeof(T));
    if (begins.back() == 0) return elements;
    if constexpr (std::is_same_v<Device, Cpu>) {
        gather(part.data(), begins, all.data(), false);
    } else if (reaches_gpu()) {
        gather_on_gpu({{part.data(), begins, all.data()}}, [] {});
    } else {
        std::vector<T> mine(count), whole(all.size());
        detail::copy(Device{}, part.data(), Cpu{}, mine.data(), count * sizeof(T));
        gather(mine.data(), begins, whole.data(), false);
        copy(whole, all);
    }
    return elements;
}

template <class Device>
void Communicator::share(const char* what,
                         Device,
                         const std::vector<Planes>& arrays,
                         const std::vector<std::size_t>& begins,
                         const std::function<void()>& meanwhile) {
    const auto own = static_cast<std::size_t>(rank());
    const auto in_bytes = [&begins](std::size_t width) {
        Begins bytes = begins;
        for (std::size_t& begin : bytes) begin *= width;
        return bytes;
    };
    std::size_t width = 0;
    std::vector<Gather> gathers;
    for (const Planes& array : arrays) {
        width += array.width * static_cast<std::size_t>(array.count);
        const Begins bytes = in_bytes(array.width);
        for (int p = 0; p < array.count; ++p) {
            std::byte* const plane =
                static_cast<std::byte*>(array.data) + static_cast<std::size_t>(p) * bytes.back();
            gathers.push_back({plane + bytes[own], bytes, plane});
        }
    }
    const Begins expected = in_bytes(width);
    require_same_parts(what, exchange_sizes(what, expected[own + 1] - expected[own]), expected);
    if constexpr (!std::is_same_v<Device, Cpu>)
        if (reaches_gpu()) return gather_on_gpu(gathers, meanwhile);
    meanwhile();
    if (expected.back() == 0) return;
    for (const Gather& g : gathers) {
        if constexpr (std::is_same_v<Device, Cpu>) {
            gather(g.part, g.begins, g.all, false);
        } else {
            std::vector<std::byte> whole(g.begins.back());
            detail::copy(Device{}, g.part, Cpu{}, whole.data() + g.begins[own],
                         g.begins[own + 1] - g.begins[own]);
            gather(whole.data() + g.begins[own], g.begins, whole.data(), false);
            detail::copy(Cpu{}, whole.data(), Device{}, g.all, whole.size());
        }
    }
}

template <class T, class Device>
std::vector<std::size_t> Communicator::all_to_all_v(const char* what,
                                                    const Buffer<T, Device>& parts,
                                                    const std::vector<std::size_t>& begins,
                                                    Buffer<T, Device>& got) {
    Begins to;
    for (const std::size_t begin : begins) to.push_back(begin * sizeof(T));
    std::vector<std::size_t> from;
    for (const std::size_t begin : exchange_places(what, to)) from.push_back(begin / sizeof(T));
    deal_known(what, parts, begins, got, from);
    return from;
}

template <class T, class Device>
void Communicator::deal_known(const char* what,
                              const Buffer<T, Device>& parts,
                              const std::vector<std::size_t>& to,
                              Buffer<T, Device>& got,
                              const std::vector<std::size_t>& from) {
    what_ = what;
    Begins sent, come;
    for (const std::size_t begin : to) sent.push_back(begin * sizeof(T));
    for (const std::size_t begin : from) come.push_back(begin * sizeof(T));
    got.resize(from.back());
    if constexpr (std::is_same_v<Device, Cpu>) {
        deal(parts.data(), sent, got.data(), come);
    } else if (reaches_gpu()) {
        deal_on_gpu(parts.data(), sent, got.data(), come);
    } else {
        std::vector<T> mine(to.back()), theirs(from.back());
        detail::copy(Device{}, parts.data(), Cpu{}, mine.data(), sent.back());
        deal(mine.data(), sent, theirs.data(), come);
        copy(theirs, got);
    }
}

/// counts[r][o]: elements that go from rank r to rank o.
using SentCounts = std::vector<std::vector<int>>;

/// Where in what rank `own` is sent that of each rank begins, and where all ends; `each` for one
/// counted.
inline std::vector<std::size_t> received_begins(const SentCounts& counts,
                                                int own,
                                                std::size_t each) {
    std::vector<std::size_t> begins{0};
    for (const std::vector<int>& sent : counts)
        begins.push_back(begins.back() +
                         each * static_cast<std::size_t>(sent[static_cast<std::size_t>(own)]));
    return begins;
}
/// The most that a rank sends or is sent.
inline std::int64_t most_of_a_rank(const SentCounts& counts) {
    std::int64_t most = 0;
    for (std::size_t r = 0; r < counts.size(); ++r) {
        std::int64_t sent = 0, received = 0;
        for (std::size_t other = 0; other < counts.size(); ++other)
            sent += counts[r][other], received += counts[other][r];
        most = std::max({most, sent, received});
    }
    return most;
}

/// The part of `count` elements that a process has to hold; all of them where there is one.
inline Part own_part(const Communicator* peers, int count) {
    return part_of(count, rank_of(peers), size_of(peers));
}

/// Of planes of `count` elements, where each process has written those of its part <- all of them.
/// Does nothing where there is one.
template <class Device>
void share_parts(
    Communicator* peers,
    const char* what,
    Device device,
    const std::vector<Communicator::Planes>& arrays,
    int count,
    const std::function<void()>& meanwhile = [] {}) {
    if (peers == nullptr) return meanwhile();
    peers->share(what, device, arrays, part_begins(count, peers->size()), meanwhile);
}
template <class T, class Device>
void share_parts(Communicator* peers, const char* what, Device device, T* data, int count) {
    share_parts(peers, what, device, std::vector<Communicator::Planes>{{data, sizeof(T)}}, count);
}

/// values <- their sum over the ranks. Does nothing where there is one process.
template <class Device>
void sum_over_ranks(Communicator* peers, const char* what, Buffer<int, Device>& values) {
    if (peers == nullptr) return;
    constexpr std::size_t kPiece = 1 << 18;  // of each rank, at a time
    std::vector<int> all = to_host(values);
    for (std::size_t begin = 0; begin < all.size(); begin += kPiece) {
        const auto first = all.begin() + static_cast<std::ptrdiff_t>(begin),
                   last = first + static_cast<std::ptrdiff_t>(std::min(kPiece, all.size() - begin));
        std::vector<std::int64_t> sums(first, last);
        peers->all_reduce(what, Communicator::Reduce::sum, sums);
        std::copy(sums.begin(), sums.end(), first);
    }
    copy(all, values);
}

}  // namespace tvsgs
