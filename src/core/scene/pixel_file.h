// Photographs in a scratch file, for scenes with more of them than memory holds.
#pragma once

#include <memory>
#include <string>

#include "core/scene/image.h"

namespace tvsgs {

/// A scratch file in `folder`. It lasts until its last image is gone. All functions throw
/// Error(ExitCode::io).
class PixelFile {
public:
    explicit PixelFile(const std::string& folder);
    PixelFile(const PixelFile&) = delete;
    PixelFile& operator=(const PixelFile&) = delete;
    ~PixelFile();

    /// Moves the image's bytes to the file; an empty image stays empty. Several threads may call
    /// it.
    void keep(ImageU8& image);

private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace tvsgs
