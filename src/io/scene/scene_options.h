// Options of reading a scene.  [docs/guide/input.md]
#pragma once

#include <cstdint>
#include <string>

#include "core/options.h"

namespace tvsgs {

/// Layout of a scene's folder; `automatic` takes the first that fits.
enum class SceneFormat { automatic, colmap, blender, nerfstudio, idr, mvsnet };

/// Where decoded photographs are kept. automatic: in a file if they exceed a share of the free
/// memory.
enum class PhotoPlace { automatic, memory, file };

/// The user's options. Comments name the flags.
struct SceneOptions {
    std::string path;                             // --scene
    SceneFormat format = SceneFormat::automatic;  // --format
    std::string cameras_file;   // idr: cameras_sphere.npz or cameras.npz; empty: whichever exists
    float pixel_offset = 0.5f;  // idr, mvsnet: added to principal points
    std::string images = "images";  // --images: folder of the photographs inside the scene
    int resolution = -1;   // -r: 1, 2, 4, 8 divide; -1: at most 1600 wide; else target width
    float grey_scale = 1;  // training size / size of the grey images; 1: use the photos
    std::string split;     // --split NAME of splits.json
    std::string train_list, test_list;  // --train-list, --test-list: one image name per line
    std::string views;  // --views I,J,K: indices into the sorted views, training only
    int num_views = 0;  // --num-views: number of training views, evenly spaced; 0: all
    bool eval = false;  // --eval: every test_every-th view is a test view
    int test_every = 8;
    std::string masks;     // --masks: folder; empty: mask/, masks/ or the alpha channel
    std::string init_ply;  // --init-ply: initial cloud instead of the model's points
    bool center_principal_point = false;  // for comparison with the official codes
    bool need_points = true;              // false: read no initial cloud (meshing, evaluation)
    bool points_required = true;          // false: an empty initial cloud is not an error
    bool given_cameras = false;           // of a run with refined cameras: use the given ones
    int min_train_views = 2;
    PhotoPlace photos = PhotoPlace::automatic;
    std::string photo_folder;       // for that file; empty: scratch, or the current folder
    std::string scratch;            // output folder of the command
    std::int64_t photo_memory = 0;  // bytes kept in memory by `automatic`; 0: by free memory

    /// The fields that belong to a run's configuration.
    template <class Visitor>
    void fields(Visitor& field) {
        field("path", path, "folder of the scene: photographs and their cameras");
        field.choice("format", format, {"auto", "colmap", "blender", "nerfstudio", "idr", "mvsnet"},
                     "layout of the folder; auto: the first that fits");
        field("cameras_file", cameras_file,
              "file with the cameras, for idr; empty: cameras_sphere.npz or cameras.npz");
        field("pixel_offset", pixel_offset, {-1, 1},
              "added to principal points, pixels, for idr and mvsnet; 0.5: pixel centres at "
              "integers, 0: pixel corners at integers");
        field("images", images, "folder of the photographs, inside the scene");
        field(
            "resolution", resolution, {-1, 65535},
            "1, 2, 4, 8: divide the size by it; -1: at most 1600 px wide; other: width in pixels");
        field("grey_scale", grey_scale, {0.05, 1},
              "training size divided by the size of the grey images for patch matching, which "
              "never exceed the files; 1: training size");
        field("split", split,
              "list of splits.json to train on; its list 'test' gives the test views; empty: none");
        field("train_list", train_list, "file of training images, one per line; empty: none");
        field("test_list", test_list, "file of test images, one per line; empty: none");
        field("views", views,
              "training views by index into the sorted images, such as 23,24,33; empty: all");
        field("num_views", num_views, {0, 1e6}, "use N evenly spaced training views; 0: all");
        field("eval", eval, "make every test_every-th view a test view");
        field("test_every", test_every, {2, 1e6}, "every Nth view is a test view, with scene.eval");
        field("masks", masks, "folder of the masks; empty: mask/, masks/ or the alpha channel");
        field("init_ply", init_ply, "start cloud (PLY); empty: the points of the scene");
        field.choice(
            "photos", photos, {"auto", "memory", "file"},
            "place of decoded photographs: memory; file: a temporary mapped file, for more "
            "photographs than memory holds; auto: file from a quarter of the free memory on");
        field("photo_folder", photo_folder,
              "folder of that file, needs 3 to 5 bytes per pixel of all photographs; empty: the "
              "run folder");
        field("center_principal_point", center_principal_point,
              "move the principal point to the image centre, as the official codes do");
    }
};

}  // namespace tvsgs
