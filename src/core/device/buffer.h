// Buffers whose type names the device that holds their memory.
#pragma once

#include <cassert>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>
#include <vector>

#include "core/device/device.h"

namespace tvsgs {

/// A view of contiguous elements. Kernel bodies index it.
template <class T>
struct Span {
    T* data = nullptr;
    std::size_t count = 0;

    TVSGS_HD T& operator[](std::size_t i) const { return data[i]; }
    TVSGS_HD int size() const { return static_cast<int>(count); }
    TVSGS_HD bool empty() const { return count == 0; }
    TVSGS_HD T* begin() const { return data; }
    TVSGS_HD T* end() const { return data + count; }
    TVSGS_HD Span sub(std::size_t first, std::size_t size) const { return {data + first, size}; }
    template <class U>
    requires(std::is_same_v<U, const T> && !std::is_const_v<T>) TVSGS_HD operator Span<U>() const {
        return {data, count};
    }
};

/// Bytes held by all buffers of a device: now, and the largest value so far.
struct MemoryUse {
    std::int64_t current_bytes, peak_bytes;
};
MemoryUse memory_use(Cpu);
MemoryUse memory_use(Cuda);

/// Host memory in bytes that is free or that the system would free at once.
std::int64_t free_host_bytes();

/// Limits the bytes that all buffers of the device may hold together. At first the only limit is
/// the memory.
void set_memory_limit(Cpu, std::int64_t bytes);
void set_memory_limit(Cuda, std::int64_t bytes);

/// Waits until the device has done all work given to it.
inline void synchronize(Cpu) {}
void synchronize(Cuda);

namespace detail {
// Throw Error(ExitCode::memory) with the requested size and the memory that is left.
void* allocate(Cpu, std::size_t bytes);
void* allocate(Cuda, std::size_t bytes);
void release(Cpu, void* data, std::size_t bytes);
void release(Cuda, void* data, std::size_t bytes);
void fill_zero(Cpu, void* data, std::size_t bytes);
void fill_zero(Cuda, void* data, std::size_t bytes);
// Copies between host and device return when the copy is done.
void copy(Cpu, const void* from, Cpu, void* to, std::size_t bytes);
void copy(Cpu, const void* from, Cuda, void* to, std::size_t bytes);
void copy(Cuda, const void* from, Cpu, void* to, std::size_t bytes);
void copy(Cuda, const void* from, Cuda, void* to, std::size_t bytes);
}  // namespace detail

/// Owns [size] elements in the memory of `Device` and is the only caller of the device's allocator.
/// Movable; copy() copies it. Growing loses the contents; shrinking keeps the memory.
template <class T, class Device>
class Buffer {
    static_assert(std::is_trivially_copyable_v<T>);

public:
    Buffer() = default;
    explicit Buffer(std::size_t size) { resize(size); }
    Buffer(Buffer&& other) noexcept { swap(other); }
    Buffer& operator=(Buffer&& other) noexcept {
        swap(other);
        return *this;
    }
    ~Buffer() { release(); }

    /// The contents are kept unless the capacity has to grow; then they are undefined.
    void resize(std::size_t size) {
        if (size > capacity_) {
            // Re-growth adds a quarter, so that slowly growing counts allocate rarely.
            const std::size_t wanted = capacity_ == 0 ? size : size + size / 4;
            release();
            data_ = static_cast<T*>(detail::allocate(Device{}, wanted * sizeof(T)));
            capacity_ = wanted;
        }
        size_ = size;
    }
    void fill_zero() { detail::fill_zero(Device{}, data_, size_ * sizeof(T)); }
    void swap(Buffer& other) noexcept {
        std::swap(data_, other.data_);
        std::swap(size_, other.size_);
        std::swap(capacity_, other.capacity_);
    }

    std::size_t size() const { return size_; }
    bool empty() const { return size_ == 0; }
    T* data() { return data_; }
    const T* data() const { return data_; }
    Span<T> span() { return {data_, size_}; }
    Span<const T> span() const { return {data_, size_}; }

    T& operator[](std::size_t i) requires std::is_same_v<Device, Cpu> {
        assert(i < size_);
        return data_[i];
    }
    const T& operator[](std::size_t i) const requires std::is_same_v<Device, Cpu> {
        assert(i < size_);
        return data_[i];
    }

private:
    void release() {
        detail::release(Device{}, std::exchange(data_, nullptr),
                        std::exchange(capacity_, 0) * sizeof(T));
        size_ = 0;
    }

    T* data_ = nullptr;
    std::size_t size_ = 0, capacity_ = 0;
};

/// Resizes and overwrites `to`.
template <class T, class From, class To>
void copy(const Buffer<T, From>& from, Buffer<T, To>& to) {
    to.resize(from.size());
    detail::copy(From{}, from.data(), To{}, to.data(), from.size() * sizeof(T));
}
template <class T, class To>
void copy(const std::vector<T>& from, Buffer<T, To>& to) {
    to.resize(from.size());
    detail::copy(Cpu{}, from.data(), To{}, to.data(), from.size() * sizeof(T));
}
template <class T, class From>
std::vector<T> to_host(const Buffer<T, From>& from) {
    std::vector<T> host(from.size());
    detail::copy(From{}, from.data(), Cpu{}, host.data(), from.size() * sizeof(T));
    return host;
}
template <class Device, class T>
Buffer<T, Device> to_device(const std::vector<T>& host) {
    Buffer<T, Device> buffer;
    copy(host, buffer);
    return buffer;
}

}  // namespace tvsgs
