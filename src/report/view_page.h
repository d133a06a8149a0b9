// Makes a page that shows runs in 3D: one file that loads nothing from elsewhere.
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

/// A run to show; all runs of a page are in one frame.
struct ViewRun {
    std::string name;
    Gaussians<Cpu> splats;       // may be empty
    TrainOptions train;          // its rendering options are used
    TriangleMesh mesh;           // without faces: no mesh
    std::size_t mesh_faces = 0;  // before it was simplified for the page
    std::optional<Truth> truth;
    JsonValue evaluations;  // of its report.json
};

struct ViewCamera {
    std::string name;
    bool test = false;
    Camera camera;
    ImageU8 photo;  // may be empty
};

struct ViewPageOptions {
    std::size_t max_bytes = 40'000'000;  // of the page, approximately
    int max_splats = 50'000'000;         // per run
    int max_photos = 60;
    bool follow = false;  // the page follows a running training through its server
    Vec3d origin{};       // of the page's frame, in the scene's frame
    bool metres = false;  // the scene's unit is the metre
};

struct ViewPage {
    std::string html;
    std::string poster;              // picture of the first run: data URI
    std::vector<std::string> notes;  // parts left out for size, in words for the page
};

/// Content security policy of pages with a 3D view: no access to other hosts.
inline constexpr const char* kViewPolicy =
    "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; script-src "
    "'unsafe-inline'; worker-src blob:";

/// `cameras`: at least one.
ViewPage view_page(std::vector<ViewRun> runs,
                   const std::vector<ViewCamera>& cameras,
                   const ViewPageOptions& options = {});

}  // namespace tvsgs
