// The bytes of an image: of their own, or in a file that is mapped.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

namespace tvsgs {

/// As std::vector<std::uint8_t>, but for where they lie: in memory, or, as PixelFile leaves them,
/// in a file, whose pages the system reads when they are looked at and drops when memory is short.
/// Copies of those share the file; whoever writes to them gets them into memory first.
class PixelBytes {
public:
    using value_type = std::uint8_t;
    using iterator = std::uint8_t*;
    using const_iterator = const std::uint8_t*;

    PixelBytes() = default;
    PixelBytes(std::vector<std::uint8_t> bytes) : own_(std::move(bytes)) {}
    PixelBytes(std::size_t count, std::uint8_t value) : own_(count, value) {}
    /// `bytes` are there as long as anyone holds them.
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

    /// A copy in memory.
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
    std::shared_ptr<const std::uint8_t> mapped_;  // null: own_
    std::size_t count_ = 0;
};

}  // namespace tvsgs
