// Copies from the host to a device that run while the device works.
#pragma once

#include <memory>

#include "core/device/buffer.h"

namespace tvsgs {

/// Runs one copy at a time. Keep one lane for each memory that is filled again and again.
template <class Device>
class CopyLane;

/// Copies at once.
template <>
class CopyLane<Cpu> {
public:
    explicit CopyLane(std::size_t /*capacity*/) {}
    void start(const void* from, void* to, std::size_t bytes) {
        detail::copy(Cpu{}, from, Cpu{}, to, bytes);
    }
    void wait() {}
};

template <>
class CopyLane<Cuda> {
public:
    /// Holds `capacity` bytes of staging memory on the host; no copy may be larger.
    explicit CopyLane(std::size_t capacity);
    CopyLane(CopyLane&&) noexcept;
    ~CopyLane();

    /// The copy begins after all work given to the device so far. Returns when `from` has been
    /// read.
    void start(const void* from, void* to, std::size_t bytes);
    /// Makes work given to the device from now on run after the copy. The host does not wait.
    void wait();

private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace tvsgs
