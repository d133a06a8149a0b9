// Reads runs from their folders for pages of tvsgs-view.
#pragma once

#include <string>
#include <vector>

#include "report/view_page.h"

namespace tvsgs {

inline constexpr std::size_t kViewFaces = 500'000;

struct ViewInput {
    std::vector<std::string> runs;  // folders, at least one
    std::string scene;              // empty: the scene of the first run
    std::string gt, crop;           // empty: the truth that the run was measured against
    bool may_train = false;         // a run without splats is allowed, as it still trains
    /// The first run's scene, if loaded already; a few of its photographs are shown.
    const Scene* loaded = nullptr;
    std::size_t max_faces = kViewFaces;
    const char* whole = "page";  // word for the page in warnings about missing parts
};

/// Input of view_page(). The frame is the frame of the first run's cameras, moved close to zero.
struct ViewSubject {
    std::vector<ViewRun> runs;
    std::vector<ViewCamera> cameras;
    Vec3d origin;                      // of the frame, in the scene's frame
    bool metres = false;               // the scene's unit is known to be the metre
    std::vector<std::string> missing;  // parts left out, with reasons
};

/// Whether the scene of a run was put in place (georeference.json) or scaled by markers
/// (prepare.json).
bool in_metres(const std::string& run, const std::string& scene);

/// Leaves out photographs, meshes and truths that cannot be read, with a warning; a truth that
/// `input` names must be readable. Simplifies meshes. Throws Error(ExitCode::input) for a folder
/// that is no run folder.
ViewSubject read_view_subject(const ViewInput& input);

}  // namespace tvsgs
