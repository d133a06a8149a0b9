// Reads maps that come with a scene (depth, normals, confidence, features): finds, interprets and
// fits them, and adds them to the views. [docs/guide/priors.md]
#pragma once

#include <string>

#include "core/scene/prior_conventions.h"
#include "io/scene/scene_options.h"
#include "optim/losses/loss.h"

namespace tvsgs {

struct PriorOptions {
    enum class Source { automatic, none, disk, stereo } source = Source::automatic;
    std::string dir;
    PriorQuantity quantity = PriorQuantity::unknown;
    float max_residual = 0.1f;

    template <class Visitor>
    void fields(Visitor& field) {
        field.choice("source", source, {"auto", "none", "disk", "stereo"},
                     "where depth and normals that losses ask for come from; auto: files beside "
                     "the scene, and stereo for views that have none; disk: files, which have to "
                     "be there");
        field("dir", dir, "folder of the priors, in the scene or here; empty: looked for");
        field.choice("quantity", quantity, {"auto", "depth", "inverse_depth", "log_depth"},
                     "what the numbers of depth maps are; auto: what fits the points");
        field("max_residual", max_residual, {1e-4, 10},
              "median error of a fitted depth map against the points, in shares of the depth; "
              "a view above is left out");
    }
};

/// Fills View::maps of the training views with the maps of core/scene/prior_maps.h that are in
/// `wanted` and on disk, if options.source allows. Fits scale and shift to Scene::points. Logs a
/// line with the result. Throws Error(ExitCode::input).
void read_priors(const PriorOptions& options,
                 const MapNames& wanted,
                 const SceneOptions& scene_options,
                 Scene& scene);

}  // namespace tvsgs
