// Maps that come from outside with a scene: found, understood, fitted and put into the views.
// [docs/guide/priors.md]
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

/// Fills View::maps of the training views with the maps of core/scene/prior_maps.h among `wanted`
/// that lie on disk, if options.source says so. Scale and shift are fitted to Scene::points. One
/// line says what was found. Throws Error(ExitCode::input).
void read_priors(const PriorOptions& options,
                 const MapNames& wanted,
                 const SceneOptions& scene_options,
                 Scene& scene);

}  // namespace tvsgs
