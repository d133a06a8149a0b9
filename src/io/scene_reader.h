// From a folder of photographs with calibrated cameras to a Scene.  [input specification, docs/input.md]
#pragma once

#include <string>
#include <vector>

#include "core/scene.h"

namespace tvsgs {

/// What the user asked for; the names are those of the command line.
struct SceneOptions {
    std::string path;                     // --scene
    std::string images = "images";        // --images: folder of the photographs inside the scene
    int resolution = -1;                  // -r: 1, 2, 4, 8 divide; -1: at most 1600 wide; else a target width
    std::string split;                    // --split NAME of splits.json
    std::string train_list, test_list;    // --train-list, --test-list: one image name per line
    std::vector<int> views;               // --views: indices into the sorted views, training only
    int num_views = 0;                    // --num-views: that many training views, evenly chosen; 0: all
    bool eval = false;                    // --eval: every test_every-th view is a test view
    int test_every = 8;
    std::string masks;                    // --masks: folder; empty: mask/, masks/ or the alpha channel
    std::string init_ply;                 // --init-ply: initial cloud instead of the model's points
    bool center_principal_point = false;  // parity with the official codes
    bool need_points = true;              // false: no initial cloud is read (meshing, evaluation)
    int min_train_views = 2;
};

/// Reads cameras, photographs (resized), masks, the split and the initial cloud. For a subset of the views only
/// points whose track holds at least two training images are kept. Throws Error(ExitCode::input) that names the
/// place, what was found and what to do.
Scene read_scene(const SceneOptions& options);

}  // namespace tvsgs
