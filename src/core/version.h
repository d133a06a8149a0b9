#pragma once

namespace tvsgs {

/// Every file that we write says it near its beginning, or stands in a list of our files
/// (io/manifest.h).
inline constexpr const char* kVersion = "tvsgs 0.1.0";

}  // namespace tvsgs
