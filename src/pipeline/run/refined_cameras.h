// RUN/cameras/: the training views of a run as it refined them, a COLMAP text model.
#pragma once

#include <string>

#include "core/scene/scene.h"
#include "io/files/json_value.h"
#include "optim/optimiser/camera_refinement.h"

namespace tvsgs {

/// Writes the training views of `scene`, which are pinholes at the size they train at.
void write_refined_cameras(const std::string& run, const Scene& scene);

/// Gives the training views of the run's scene their refined poses, by name; those that the run has
/// not refined stay as they are. Nothing where a run has refined none.
/// Throws Error(ExitCode::input).
void adopt_refined_cameras(const std::string& run, Scene& scene);

/// How far each view moved, for the log: {"views": {NAME: {"turn_px": ...}}}.
JsonValue camera_moves_json(const Scene& scene, const CameraRefinement& refined);

/// The same for people, in one line.
std::string camera_moves_text(const CameraRefinement& refined);

}  // namespace tvsgs
