// A page to look at runs with: one file, which asks nobody for anything.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/scene/gaussians.h"
#include "core/scene/image.h"
#include "core/scene/mesh.h"
#include "io/files/json_value.h"
#include "optim/loop/train.h"
#include "pipeline/run/train_evaluation.h"

namespace tvsgs {

/// A run as it is shown; all runs of a page are in one frame.
struct ViewRun {
    std::string name;
    Gaussians<Cpu> splats;       // may be none
    TrainOptions train;          // what they are drawn with
    TriangleMesh mesh;           // without faces: none
    std::size_t mesh_faces = 0;  // before it was made small enough for a page
    std::optional<Truth> truth;
    JsonValue evaluations;  // of its report.json
};

struct ViewCamera {
    std::string name;
    bool test = false;
    Camera camera;
    ImageU8 photo;  // empty: not there
};

struct ViewPageOptions {
    std::size_t max_bytes = 40'000'000;  // of the page, about
    int max_splats = 50'000'000;         // of a run
    int max_photos = 60;
    /// The page follows a training, by the server that it is from; where its frame lies in that of
    /// the scene.
    std::optional<Vec3d> follow{};
};

struct ViewPage {
    std::string html;
    std::string poster;              // a picture of the first run: data URI
    std::vector<std::string> notes;  // what does not fit, as the page says it
};

/// What pages with a view in them may do: nothing that leaves them.
inline constexpr const char* kViewPolicy =
    "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; script-src "
    "'unsafe-inline'; worker-src blob:";

/// `cameras`: at least one.
ViewPage view_page(std::vector<ViewRun> runs,
                   const std::vector<ViewCamera>& cameras,
                   const ViewPageOptions& options = {});

}  // namespace tvsgs
