// Copies from the host to a device beside the work that the device does.
#pragma once

#include <memory>

#include "core/device/buffer.h"

namespace tvsgs {

/// One copy at a time; a lane goes with the memory that it fills again and again.
template <class Device>
class CopyLane;

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
    /// For copies of up to `capacity` bytes, which it also holds on the host.
    explicit CopyLane(std::size_t capacity);
    CopyLane(CopyLane&&) noexcept;
    ~CopyLane();

    /// Begins after all work given to the device so far, and returns when `from` has been read.
    void start(const void* from, void* to, std::size_t bytes);
    /// Work given to the device from now on comes after the copy. The host does not wait.
    void wait();

private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace tvsgs
