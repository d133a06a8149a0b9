// Order between the library, which works on the default stream, and the caller's stream.
#pragma once

#include <cstddef>
#include <cstring>

#include "core/device/device.h"

namespace tvsgs {

/// The calling thread's GPU; -1 without one.
int current_gpu();

/// Restores the calling thread's GPU at the end of a scope.
class KeptGpu {
public:
    KeptGpu() {
        if constexpr (kHasCuda) gpu_ = current_gpu();
    }
    KeptGpu(const KeptGpu&) = delete;
    KeptGpu& operator=(const KeptGpu&) = delete;
    ~KeptGpu() {
        if constexpr (kHasCuda) restore();
    }

private:
    void restore() const;
    int gpu_ = -1;
};

/// While it lives, the library works on its GPU, between earlier and later work of the stream.
template <class Device>
class CallerTurn;

template <>
class CallerTurn<Cpu> {
public:
    CallerTurn(int /*gpu*/, void* /*stream*/) {}
    /// Copies between any memory.
    void copy(const void* from, void* to, std::size_t bytes) const {
        if (bytes > 0) std::memcpy(to, from, bytes);
    }
};

template <>
class CallerTurn<Cuda> {
public:
    CallerTurn(int gpu, void* stream);
    ~CallerTurn();
    /// Returns at once between device memory, else when the copy is done.
    void copy(const void* from, void* to, std::size_t bytes) const;

private:
    KeptGpu kept_;
    struct Event {
        void* handle = nullptr;
        ~Event();
    } event_;
    void* stream_;
};

}  // namespace tvsgs
