// Photographs beside memory: more of them than it holds.
#pragma once

#include <memory>
#include <string>

#include "core/scene/image.h"

namespace tvsgs {

/// A scratch file in `folder`, which lasts as long as what is kept in it. All throw
/// Error(ExitCode::io).
class PixelFile {
public:
    explicit PixelFile(const std::string& folder);
    PixelFile(const PixelFile&) = delete;
    PixelFile& operator=(const PixelFile&) = delete;
    ~PixelFile();

    /// Moves the image's bytes there, of an empty image none. May be called by several threads.
    void keep(ImageU8& image);

private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace tvsgs
