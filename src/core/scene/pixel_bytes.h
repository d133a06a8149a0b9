// Bytes of an image, in memory or in a mapped file.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

namespace tvsgs {

/// Like std::vector<std::uint8_t>, but the bytes lie in memory or in a file mapped by PixelFile.
/// The system reads pages of the file on access and drops them when memory is short. Copies share
/// the mapped file; the first write access copies the bytes to memory.
class PixelBytes {
public:
    using value_type = std::uint8_t;
    using iterator = std::uint8_t*;
    using const_iterator = const std::uint8_t*;

    PixelBytes() = default;
    PixelBytes(std::vector<std::uint8_t> bytes) : own_(std::move(bytes)) {}
    PixelBytes(std::size_t count, std::uint8_t value) : own_(count, value) {}
    /// Uses `count` bytes that the shared pointer keeps alive.
    PixelBytes(std::shared_ptr<const std::uint8_t> bytes, std::size_t count)
        : mapped_(std::move(bytes)), count_(count) {}

    bool in_file() const { return mapped_ != nullptr; }
    std::size_t size() const { return mapped_ ? count_ : own_.size(); }
    bool empty() const { return size() == 0; }
    const std::uint8_t* data() const { return mapped_ ? mapped_.get() : own_.data(); }
    const std::uint8_t* begin() const { return data(); }
    const std::uint8_t* end() const { return data() + size(); }
    const std::uint8_t& operator[](std::size_t i) const { return data()[i]; }

    std::uint8_t* data() { return own().data(); }
    std::uint8_t* begin() { return data(); }
    std::uint8_t* end() { return data() + size(); }
    std::uint8_t& operator[](std::size_t i) { return own()[i]; }
    void resize(std::size_t count) { own().resize(count); }
    void push_back(std::uint8_t value) { own().push_back(value); }
    void assign(std::size_t count, std::uint8_t value) { own().assign(count, value); }

    /// Copies the bytes to memory.
    std::vector<std::uint8_t> to_vector() const { return {begin(), end()}; }

    friend bool operator==(const PixelBytes& a, const PixelBytes& b) {
        return a.size() == b.size() && std::equal(a.begin(), a.end(), b.begin());
    }

private:
    std::vector<std::uint8_t>& own() {
        if (mapped_) own_ = to_vector(), mapped_.reset();
        return own_;
    }

    std::vector<std::uint8_t> own_;
    std::shared_ptr<const std::uint8_t> mapped_;  // null: the bytes are in own_
    std::size_t count_ = 0;
};

}  // namespace tvsgs
