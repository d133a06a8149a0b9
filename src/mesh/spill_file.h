#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace tvsgs {

/// Memory on disk: a file in `folder` that has no name, so that nothing of it is left however the
/// program ends. The folder is made where it is missing. All throw Error(ExitCode::io).
class SpillFile {
public:
    explicit SpillFile(const std::string& folder);
    SpillFile(const SpillFile&) = delete;
    SpillFile& operator=(const SpillFile&) = delete;
    ~SpillFile();

    struct Place {
        std::int64_t offset = 0;
        std::size_t count = 0;
    };

    template <class T>
    Place append(const T* values, std::size_t count) {
        return {append_bytes(values, count * sizeof(T)), count};
    }
    template <class T>
    void read(Place place, std::vector<T>& values) const {
        values.resize(place.count);
        read_bytes(place.offset, values.data(), place.count * sizeof(T));
    }
    std::int64_t bytes() const { return bytes_; }

private:
    std::int64_t append_bytes(const void* data, std::size_t bytes);  // returns where
    void read_bytes(std::int64_t offset, void* data, std::size_t bytes) const;

    std::string folder_;
    int file_ = -1;
    std::int64_t bytes_ = 0;
};

}  // namespace tvsgs
