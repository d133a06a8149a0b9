// Reading of a Scene from a folder of photographs with calibrated cameras.  [docs/guide/input.md]
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/scene/scene.h"
#include "io/scene/scene_layout.h"
#include "io/scene/scene_options.h"

namespace tvsgs {

/// Training and test views.
struct ViewSplit {
    std::vector<int> train, test;  // indices into the names, ascending, no index in both
};

/// `names`: all images of the model, sorted. `exists`: which of them are on disk. `own_train` and
/// `own_test`: the scene's own split by name, used if the user gave no list, also with --eval.
/// Skips missing images, except images that the user listed for training: these are errors. Throws
/// Error(ExitCode::input or usage).
ViewSplit split_views(const SceneOptions& options,
                      const std::vector<std::string>& names,
                      const std::vector<bool>& exists,
                      const std::vector<std::string>& own_train = {},
                      const std::vector<std::string>& own_test = {});

/// The views of a scene before any photograph is read, so that decisions can depend on their
/// number.
struct ChosenViews {
    SceneLayout layout;
    std::vector<std::optional<std::string>> files;  // one per layout.model.images; empty: missing
    ViewSplit split;
};

/// Where the photographs of the chosen views will be kept.
struct PhotoStorage {
    bool in_file = false;
    std::int64_t bytes = 0, limit = 0;  // estimated size of all photographs; limit for memory

    /// "4.8 > 2.1 GB, a quarter of the memory that is free".
    std::string reason() const;
};
PhotoStorage photo_storage(const ChosenViews& chosen, const SceneOptions& options);

/// Finds the layout, the cameras, the photographs' files and the split. Throws
/// Error(ExitCode::input) with the place, the finding and advice.
ChosenViews choose_views(const SceneOptions& options);

/// Reads photographs (resized), masks and the initial cloud. For a subset of the views, keeps only
/// points whose track contains at least two training images. `options` must select the same views
/// as in choose_views(). Throws like choose_views().
Scene load_scene(const ChosenViews& chosen, const SceneOptions& options);

/// choose_views() followed by load_scene().
Scene read_scene(const SceneOptions& options);

/// Scene::origin of the scene, without reading photographs.
Vec3d read_scene_origin(const SceneOptions& options);

/// Drops points that are not finite, farther than 1e9, or at the position of an earlier point (zero
/// distance to a neighbour). Warns and names `source`. Returns the number of dropped points.
std::size_t drop_invalid_points(PointCloud& cloud, const std::string& source);

/// Scene::extent of these training views.
float scene_extent(const Scene& scene);

/// Size of the training images for -r.  [docs/method/input.md#sizes-of-photographs]
struct PixelSize {
    int width_px, height_px;
};
PixelSize resized_size(int resolution, int width_px, int height_px);

}  // namespace tvsgs
