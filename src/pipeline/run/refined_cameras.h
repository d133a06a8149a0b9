// Writes and reads RUN/cameras/: the refined training views of a run, as a COLMAP text model.
#pragma once

#include <string>

#include "core/scene/scene.h"
#include "io/files/json_value.h"
#include "optim/optimiser/camera_refinement.h"

namespace tvsgs {

/// Writes the training views of `scene`: pinhole cameras at training size.
void write_refined_cameras(const std::string& run, const Scene& scene);

/// Sets the refined poses of the run on the scene's training views, by name; keeps other views.
/// Does nothing where the run has no refined poses. Throws Error(ExitCode::input).
void apply_refined_cameras(const std::string& run, Scene& scene);

/// Motion of each view, for the log: {"views": {NAME: {"turn_px": ...}}}.
JsonValue camera_moves_json(const Scene& scene, const CameraRefinement& refined);

/// Summary of the motion in one line.
std::string camera_moves_text(const CameraRefinement& refined);

}  // namespace tvsgs
