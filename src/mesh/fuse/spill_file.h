// Scratch file for arrays that do not fit into memory.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "core/scratch_file.h"

namespace tvsgs {

/// Stores arrays one after the other. All functions throw Error(ExitCode::io).
class SpillFile {
public:
    /// Makes the folder if it does not exist.
    explicit SpillFile(const std::string& folder) : file_(made(folder), kPurpose) {}

    struct Place {
        std::int64_t offset = 0;
        std::size_t count = 0;
    };

    template <class T>
    Place append(const T* values, std::size_t count) {
        const Place place{bytes_, count};
        file_.write(bytes_, values, count * sizeof(T));
        bytes_ += static_cast<std::int64_t>(count * sizeof(T));
        return place;
    }
    template <class T>
    void read(Place place, std::vector<T>& values) const {
        values.resize(place.count);
        file_.read(place.offset, values.data(), place.count * sizeof(T));
    }
    std::int64_t bytes() const { return bytes_; }

private:
    static constexpr const char* kPurpose =
        "what does not fit into --memory is kept in this folder for a while";

    /// Ignores a failure, because creating the file reports it.
    static const std::string& made(const std::string& folder) {
        std::error_code code;
        std::filesystem::create_directories(folder, code);
        return folder;
    }

    ScratchFile file_;
    std::int64_t bytes_ = 0;
};

}  // namespace tvsgs
