// The folder that a reader of priors finds: maps as NPY files, and priors.json that says what they
// are.  [docs/guide/priors.md#priorsjson]
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "apps/priors/recipe.h"
#include "core/image.h"
#include "io/json_value.h"

namespace tvsgs::priors {

/// What priors.json says of the maps.
JsonValue section_of(const Recipe& recipe, const std::string& producer);

class PriorsFolder {
public:
    /// Looks and changes nothing but for beginning the folder. Throws Error(ExitCode::usage) where
    /// there are files that tvsgs has not written; maps found by their names, which a priors.json
    /// would hide; or, without `overwrite`, maps of this kind that are meant otherwise, or come of
    /// another network; Error(ExitCode::input) where two views would share a map. `scene` and
    /// `views` are as find_priors() takes them.
    PriorsFolder(const std::string& folder,
                 MapKind kind,
                 JsonValue section,
                 bool overwrite,
                 const std::string& scene,
                 const std::vector<std::string>& views);

    /// Whether an earlier run of the same network has written the view's map.
    bool has(const std::string& view) const;

    /// Adds the map of a view. With the first one priors.json says so, and maps that these replace
    /// are removed. Depth is [height, width], normals [height, width, 3], features [channels,
    /// height, width].
    void write(const std::string& view, const ImageF& map);

private:
    std::filesystem::path path_of(const std::string& view) const;
    void remove_replaced() const;
    void write_json() const;

    std::filesystem::path folder_;
    MapKind kind_;
    JsonValue section_, root_;
    bool continues_ = false;  // the maps that are there are of this section
    bool begun_ = false;
};

}  // namespace tvsgs::priors
