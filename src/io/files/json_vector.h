// Vectors in JSON files.
#pragma once

#include <limits>

#include "core/math/vec.h"
#include "io/files/json_value.h"

namespace tvsgs {

/// A list of three numbers; NaN where it is something else.
inline Vec3d vector_of(const JsonValue& list) {
    constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
    Vec3d out{kNone, kNone, kNone};
    for (std::size_t c = 0; list.items.size() == 3 && c < 3; ++c)
        out[static_cast<int>(c)] = list.items[c].number_or(kNone);
    return out;
}

}  // namespace tvsgs
