// From a folder of photographs with calibrated cameras to a Scene.  [docs/guide/input.md]
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/scene/scene.h"
#include "io/scene/scene_layout.h"
#include "io/scene/scene_options.h"
#include "io/scene/view_split.h"

namespace tvsgs {

/// Which views a scene is made of, before a photograph is read: what depends on their number can
/// still be decided.
struct ChosenViews {
    SceneLayout layout;
    std::vector<std::optional<std::string>> files;  // of layout.model.images; empty: missing
    ViewSplit split;
};

/// Where the photographs of these views would be while they are in use.
struct PhotoStorage {
    bool in_file = false;
    std::int64_t bytes = 0, limit = 0;  // of all of them, about; what may be in memory

    /// "4.8 > 2.1 GB, a quarter of the memory that is free".
    std::string reason() const;
};
PhotoStorage photo_storage(const ChosenViews& chosen, const SceneOptions& options);

/// Finds the layout, the cameras, the photographs' files and the split. Throws
/// Error(ExitCode::input) that names the place, what was found and what to do.
ChosenViews choose_views(const SceneOptions& options);

/// Reads photographs (resized), masks and the initial cloud. For a subset of the views only points
/// whose track holds at least two training images are kept. `options` may differ from those of
/// choose_views() in how views are read, not in which. Throws as choose_views() does.
Scene load_scene(const ChosenViews& chosen, const SceneOptions& options);

/// Both in a row.
Scene read_scene(const SceneOptions& options);

/// Its Scene::origin alone, without the photographs.
Vec3d read_scene_origin(const SceneOptions& options);

/// Drops points that are not finite, beyond 1e9, or at the place of an earlier one, which would
/// have no distance to its neighbours; warns, naming `source`. Returns how many.
std::size_t drop_unusable(PointCloud& cloud, const std::string& source);

/// What Scene::extent is for these training views.
float scene_extent(const Scene& scene);

/// Size of the training images for -r.  [docs/method/input.md#sizes-of-photographs]
struct PixelSize {
    int width_px, height_px;
};
PixelSize resized_size(int resolution, int width_px, int height_px);

}  // namespace tvsgs
