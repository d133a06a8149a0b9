// What the processes of one training tell each other.
//
// Libraries move bytes and our own loops add: a sum of floats that a library makes depends on how
// many processes there are. So everything is gathered, in the order of the ranks, and added alike
// on all of them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <type_traits>
#include <vector>

#include "core/buffer.h"
#include "core/error.h"

namespace tvsgs {

/// The processes of a training, one for each device. All make the same calls in the same order; a
/// call that differs on one of them is found out, and is an Error(ExitCode::peer), as is waiting
/// for longer than the limit. A null pointer stands for a process by itself.
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
    /// What a backend has to do: all[begins[r], begins[r + 1]) <- part of rank r. `calm`: long
    /// waits are to be expected, and need not be noticed at once when they end. Calls
    /// keep_waiting() again and again.
    virtual void gather(const void* part, const Begins& begins, void* all, bool calm) = 0;

    /// The same from and to memory of the GPU, for backends that reach it.
    virtual bool reaches_gpu() const { return false; }
    virtual void gather_on_gpu(const void* part, const Begins& begins, void* all);

    /// Throws Error(ExitCode::peer) when that has taken too long.
    void keep_waiting(double seconds);

private:
    /// Sizes of the parts; checks that the ranks are in the same call.
    Begins exchange_sizes(const char* what, std::size_t bytes, bool calm);

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
    const Begins begins = exchange_sizes(what, count * sizeof(T), false);
    all.resize(begins.back() / sizeof(T));
    std::vector<std::size_t> elements;
    for (const std::size_t begin : begins) elements.push_back(begin / sizeof(T));
    if (begins.back() == 0) return elements;
    if constexpr (std::is_same_v<Device, Cpu>) {
        gather(part.data(), begins, all.data(), false);
    } else if (reaches_gpu()) {
        gather_on_gpu(part.data(), begins, all.data());
    } else {
        std::vector<T> mine(count), whole(all.size());
        detail::copy(Device{}, part.data(), Cpu{}, mine.data(), count * sizeof(T));
        gather(mine.data(), begins, whole.data(), false);
        copy(whole, all);
    }
    return elements;
}

/// values <- their sum over the ranks. Does nothing where there is one process.
template <class Device>
void sum_over_ranks(Communicator* peers, const char* what, Buffer<int, Device>& values) {
    if (peers == nullptr) return;
    const std::vector<int> mine = to_host(values);
    std::vector<std::int64_t> sums(mine.begin(), mine.end());
    peers->all_reduce(what, Communicator::Reduce::sum, sums);
    copy(std::vector<int>(sums.begin(), sums.end()), values);
}

}  // namespace tvsgs
