// Reads maps that come with a scene (depth, normals, confidence, features): finds, interprets and
// fits them, and adds them to the views. [docs/guide/priors.md]
#pragma once

#include <string>
#include <vector>

#include "core/scene/prior_conventions.h"
#include "io/scene/scene_options.h"
#include "optim/losses/losses_list.h"

namespace tvsgs {

struct PriorOptions {
    enum class Source { automatic, none, disk, stereo } source = Source::automatic;
    std::string dir;
    PriorQuantity quantity = PriorQuantity::unknown;
    float max_residual = 0.1f;

    template <class Visitor>
    void fields(Visitor& field) {
        field.choice("source", source, {"auto", "none", "disk", "stereo"},
                     "source of the depth and normals that losses use; auto: files beside the "
                     "scene, stereo for views without; disk: files only, an error if missing");
        field("dir", dir, "folder of the priors, in the scene or here; empty: search the scene");
        field.choice("quantity", quantity, {"auto", "depth", "inverse_depth", "log_depth"},
                     "quantity in the depth maps; auto: the one that fits the points");
        field("max_residual", max_residual, {1e-4, 10},
              "largest median error of a fitted depth map, as a share of the depth; a view above "
              "it is ignored");
    }
};

/// Fills View::maps of the training views with the maps of core/scene/prior_maps.h that are in
/// `wanted` and on disk, if options.source allows. Fits scale and shift to Scene::points. Logs a
/// line with the result. Throws Error(ExitCode::input).
void read_priors(const PriorOptions& options,
                 const MapNames& wanted,
                 const SceneOptions& scene_options,
                 Scene& scene);

/// Call once after all readers have added maps. If a term needs features and no view has any, adds
/// descriptors of the photographs and logs it. Throws Error(ExitCode::usage), naming all other maps
/// that no view has.
void complete_maps(const LossOptions& options, std::vector<View>& views);

}  // namespace tvsgs
