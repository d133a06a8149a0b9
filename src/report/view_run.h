// Runs as pages of tvsgs-view show them, read from their folders.
#pragma once

#include <string>
#include <vector>

#include "report/view_page.h"

namespace tvsgs {

inline constexpr std::size_t kViewFaces = 500'000;

struct ViewInput {
    std::vector<std::string> runs;  // folders, at least one
    std::string scene;              // empty: that of the first run
    std::string gt, crop;           // empty: what a run has been measured against
    bool may_train = false;         // a run that has no splats yet is shown without
    /// The first run's scene, where it has been read: a few of its photographs are shown.
    const Scene* loaded = nullptr;
    std::size_t max_faces = kViewFaces;
    const char* whole = "page";  // what warnings say does without a part
};

/// What view_page() takes. The frame is that of the first run's cameras, moved near to zero.
struct ViewSubject {
    std::vector<ViewRun> runs;
    std::vector<ViewCamera> cameras;
    Vec3d origin;                      // of the frame, in that of the scene
    std::vector<std::string> missing;  // parts that were left out, and why
};

/// Photographs, meshes and truths that cannot be read are left out with a warning, but for a truth
/// that `input` names. Meshes are simplified. Throws Error(ExitCode::input) for what
/// is no run folder.
ViewSubject read_view_subject(const ViewInput& input);

}  // namespace tvsgs
