// What the processes of one training tell each other.
#pragma once

#include <cstddef>
#include <vector>

#include "core/buffer.h"

namespace tvsgs {

/// The processes of a training, one for each device. All make the same calls in the same order,
/// each with as many bytes as the others. A null pointer stands for a process by itself.
class Communicator {
public:
    virtual ~Communicator() = default;
    virtual int rank() const = 0;  // 0 <= rank < size
    virtual int size() const = 0;

    /// Writes the parts of all ranks to `all`, from rank 0 on, on each of them.
    virtual void gather(const void* part, std::size_t bytes, void* all) = 0;
};

inline int rank_of(const Communicator* peers) {
    return peers == nullptr ? 0 : peers->rank();
}
inline int size_of(const Communicator* peers) {
    return peers == nullptr ? 1 : peers->size();
}

/// The values of all ranks, from rank 0 on; only what this one has where it is by itself.
template <class T, class Device>
std::vector<T> gather_ranks(Communicator* peers, const Buffer<T, Device>& values) {
    const std::vector<T> mine = to_host(values);
    if (peers == nullptr) return mine;
    std::vector<T> all(mine.size() * static_cast<std::size_t>(peers->size()));
    peers->gather(mine.data(), mine.size() * sizeof(T), all.data());
    return all;
}

/// values <- their mean over the ranks, added up from rank 0 on: the same bits on all of them. `T`
/// is made of `Real`s. Does nothing where there is one process.
template <class Real, class T, class Device>
void mean_over_ranks(Communicator* peers, Buffer<T, Device>& values) {
    static_assert(sizeof(T) % sizeof(Real) == 0);
    if (peers == nullptr) return;
    const std::vector<T> all = gather_ranks(peers, values);
    std::vector<T> mean(values.size());
    const std::size_t count = mean.size() * (sizeof(T) / sizeof(Real));
    const auto* const parts = reinterpret_cast<const Real*>(all.data());
    auto* const out = reinterpret_cast<Real*>(mean.data());
    for (std::size_t i = 0; i < count; ++i) {
        Real sum = 0;
        for (int rank = 0; rank < peers->size(); ++rank)
            sum += parts[static_cast<std::size_t>(rank) * count + i];
        out[i] = sum / static_cast<Real>(peers->size());
    }
    copy(mean, values);
}

}  // namespace tvsgs
