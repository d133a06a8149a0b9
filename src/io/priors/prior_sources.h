// Search for prior files beside a scene, with their conventions, and reading of single maps in the
// formats of various programs.
// [docs/guide/priors.md#where-files-are-looked-for, docs/guide/priors.md#how-files-are-understood]
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/scene/prior_conventions.h"
#include "io/priors/prior_placement.h"

namespace tvsgs {

/// Order of an array's axes. automatic: the axis with the expected length holds the channels.
enum class MapLayout { automatic, hwc, chw };

// Each function throws Error(ExitCode::input), E_PRIOR_FILE, that names the file, and compares the
// size in the header with the file before it allocates memory. Rows come from the top, channels
// interleaved.

/// PFM: "Pf" or "PF", rows from the bottom, either byte order.
ImageF read_pfm(const std::string& path);

/// ACMM, ACMP, ACMMP: int32 type 1, height, width, channels; then interleaved float32.
ImageF read_dmb(const std::string& path);

/// COLMAP's dense stereo maps: "width&height&channels&", then float32, channel by channel.
ImageF read_colmap_map(const std::string& path);

/// An array of two axes, or of three axes with `channels` on one of them (0: any number); ignores
/// axes of length 1. If `channels` is 0, `automatic` means CHW.
ImageF read_npy_map(const std::string& path,
                    int channels = 1,
                    MapLayout layout = MapLayout::automatic);

/// The numbers of an image file. With `channels` 1, an image of several equal channels (grey saved
/// as colour) is accepted; unequal channels throw E_PRIOR_FILE.
ImageF read_picture_map(const std::string& path, int channels = 1);

/// Chooses one of the functions above by the extension: .pfm, .dmb, .bin, .npy, .png (or .jpg).
/// `channels`: 1 for depth, 3 for normals, 0 for descriptors.
ImageF read_prior_map(const std::string& path,
                      int channels = 1,
                      MapLayout layout = MapLayout::automatic);

/// The map of one view.
struct PriorFile {
    std::string path;
    double scale = 1, shift = 0;  // the map is scale * number + shift
    std::optional<PhotoWindow> window;
    bool unreliable = false;  // scale and shift are outliers and are not applied
};

/// The maps of one kind.
struct PriorFiles {
    std::string what;  // place of the files: "depth_npy/*_pred.npy"; empty: none found
    std::map<std::string, PriorFile> files;  // by the view's name
    bool centre_crop = false;                // square maps of other photographs show their middle
    MapLayout layout = MapLayout::automatic;

    bool empty() const { return files.empty(); }
};

/// Depth maps with their convention.
struct DepthSource : PriorFiles {
    DepthConvention convention;
    std::vector<double> invalid;  // numbers that mean "no value"
};

enum class NumberRange { automatic, unit, as_signed };  // of normals: [0, 1] or [-1, 1]
/// Normal maps with their convention.
struct NormalSource : PriorFiles {
    NormalConvention convention;
    NumberRange range = NumberRange::automatic;
};

/// Confidence maps.
struct ConfidenceSource : PriorFiles {
    bool from_one = false;  // c >= 1, such as 1 + exp(...); then 1 - 1 / c is in [0, 1)
};

/// All priors of a scene.
struct PriorSources {
    DepthSource depth;
    NormalSource normal;
    ConfidenceSource confidence;  // of depth and normals
    PriorFiles features, sky;     // sky: images, 255 is sky
};

/// Request for the priors of a scene's views.
struct PriorQuery {
    std::string scene;   // folder
    std::string folder;  // in the scene or the current folder; empty: search in the scene
    std::vector<std::string> views;  // names of photographs as listed in the model
};

/// Finds priors.json, or files of the formats in that page's table; takes the first format found
/// for each kind. Throws Error(ExitCode::input): E_PRIORS if a given folder has no priors, and
/// errors in files that declare conventions.
PriorSources find_priors(const PriorQuery& query);

/// The folders that find_priors() searches, for messages.
std::vector<std::string> prior_folders(const PriorQuery& query);

// Parts of find_priors().

/// Assigns the files below `folder` whose names end in one of `endings` to views. A file belongs to
/// a view if their names agree: the view's name without its extension, its last part if unique, or
/// the number that both names consist of. Uses the first ending that any view has. View names may
/// end in "_rgb". `whole_names`: the endings follow the view's whole name with its extension.
PriorFiles match_priors(const std::string& folder,
                        const std::vector<std::string>& endings,
                        const std::vector<std::string>& views,
                        bool whole_names = false);

/// Reads a folder with priors.json.
PriorSources read_priors_json(const std::string& folder, const std::vector<std::string>& views);

/// Adds scale and offset per image from 3DGS's depth_params.json to `source`.
void read_depth_params(const std::string& path, DepthSource& source);

/// depth_file_path of transforms.json; empty if no frame has one.
DepthSource read_transforms_depth(const std::string& folder, const std::vector<std::string>& views);

}  // namespace tvsgs
