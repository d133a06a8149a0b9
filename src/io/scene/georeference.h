// The coordinate system of a scene in metres at its true place: georeference.json in the folder of
// the scene, and in the folders of its runs. [docs/guide/photographs.md#true-scale-and-place]
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "core/math/vec.h"
#include "io/files/json_value.h"

namespace tvsgs {

struct Georeference {
    std::string projection{};  // EPSG:n, or a PROJ string; one line
    Vec3d origin{};            // Scene::origin, in the projection
};

/// A list of three numbers; NaN where it is something else.
Vec3d vector_of(const JsonValue& list);

/// Whether headers of text formats can contain the text.
bool is_one_line(std::string_view text);

/// Empty: the folder has none. Throws Error(ExitCode::input).
std::optional<Georeference> read_georeference(const std::string& folder);

void write_georeference(const std::string& folder, const Georeference& georeference);

/// The projection of a folder; empty: none.
inline std::string projection_of(const std::string& folder) {
    const auto found = read_georeference(folder);
    return found ? found->projection : "";
}

/// Turns z, which is up in every projection, to +y, which is up in viewers of GLB.
inline constexpr Mat3<double> kUprightFromProjection{{{1, 0, 0}, {0, 0, 1}, {0, -1, 0}}};

}  // namespace tvsgs
