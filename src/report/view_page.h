// Makes a page that shows runs in 3D, one file that loads nothing from elsewhere, and reads the
// runs from their folders.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/scene/gaussians.h"
#include "core/scene/image.h"
#include "core/scene/mesh.h"
#include "io/files/json_value.h"
#include "io/mesh/mesh_files.h"
#include "optim/loop/train.h"
#include "pipeline/run/train_evaluation.h"

namespace tvsgs {

/// A run to show; all runs of a page are in one frame.
struct ViewRun {
    std::string name;
    Gaussians<Cpu> splats;       // may be empty
    TrainOptions train;          // its rendering options are used
    TriangleMesh mesh;           // without faces: no mesh
    EncodedTexture texture;      // of the mesh; empty: the page shows the colours of its vertices
    std::size_t mesh_faces = 0;  // before it was simplified for the page
    std::optional<Truth> truth;
    JsonValue evaluations;  // of its report.json
};

struct ViewCamera {
    std::string name;
    bool test = false;
    Camera camera{};        // of the photograph turned upright
    ImageU8 photo{};        // turned upright; may be empty
    int upright_turns = 0;  // that were made; see View
};

struct ViewPageOptions {
    std::size_t max_bytes = 40'000'000;  // of the page, approximately
    int max_splats = 50'000'000;         // per run
    int max_photos = 60;
    bool follow = false;  // the page follows a running training through its server
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

inline constexpr std::size_t kViewFaces = 500'000;

struct ViewInput {
    std::vector<std::string> runs;  // folders, at least one; or one file of splats
    std::string scene;              // empty: the scene of the first run
    std::string gt, crop;           // empty: the truth that the run was measured against
    bool may_train = false;         // a run without splats is allowed, as it still trains
    /// The first run's scene, if loaded already; a few of its photographs are shown.
    const Scene* loaded = nullptr;
    std::size_t max_faces = kViewFaces;
    const char* whole = "page";  // word for the page in warnings about missing parts
};

/// The content of a page, in the frame of the first run's cameras, moved close to zero.
struct ViewSubject {
    std::vector<ViewRun> runs;
    std::vector<ViewCamera> cameras;     // at least one
    Vec3d origin{};                      // of the frame, in the scene's frame
    bool metres = false;                 // the scene's unit is known to be the metre
    std::vector<std::string> missing{};  // parts left out, with reasons
};

/// Leaves out photographs, meshes and truths that cannot be read, with a warning; a truth that
/// `input` names must be readable. Simplifies meshes. Throws Error(ExitCode::input) for a folder
/// that is no run folder.
ViewSubject read_view_subject(const ViewInput& input);

ViewPage view_page(ViewSubject subject, const ViewPageOptions& options = {});

}  // namespace tvsgs
