// Which files of priors lie beside a scene, and how they are meant.
// [docs/guide/priors.md#where-files-are-looked-for]
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/scene/prior_conventions.h"
#include "io/priors/prior_files.h"
#include "io/priors/prior_placement.h"

namespace tvsgs {

/// The map of one view.
struct PriorFile {
    std::string path;
    double scale = 1, shift = 0;  // the map is scale * number + shift
    std::optional<PhotoWindow> window;
    bool unreliable = false;  // its own program says so of scale and shift, which are not applied
};

/// The maps of one kind.
struct PriorFiles {
    std::string what;  // where they were found: "depth_npy/*_pred.npy"; empty: nowhere
    std::map<std::string, PriorFile> files;  // by the view's name
    bool centre_crop = false;  // square ones of a photograph that is not: of its middle
    MapLayout layout = MapLayout::automatic;

    bool empty() const { return files.empty(); }
};

struct DepthSource : PriorFiles {
    DepthConvention convention;
    std::vector<double> invalid;  // numbers that stand for nothing
};

enum class NumberRange { automatic, unit, as_signed };  // of normals: [0, 1] or [-1, 1]
struct NormalSource : PriorFiles {
    NormalConvention convention;
    NumberRange range = NumberRange::automatic;
};

struct ConfidenceSource : PriorFiles {
    bool from_one = false;  // c >= 1, as 1 + exp(...); 1 - 1 / c is in [0, 1)
};

struct PriorSources {
    DepthSource depth;
    NormalSource normal;
    ConfidenceSource confidence;  // of depth and normals
    PriorFiles features, sky;     // sky: pictures, 255 is sky
};

struct PriorQuery {
    std::string scene;               // folder
    std::string folder;              // in the scene or here; empty: looked for in the scene
    std::vector<std::string> views;  // names of photographs as listed in the model
};

/// Finds priors.json or files of the formats in that page's table, of each kind the first there is.
/// Throws Error(ExitCode::input): E_PRIORS where a given folder has none, and for what is wrong
/// with a file that says how they are meant.
PriorSources find_priors(const PriorQuery& query);

/// Where find_priors() looks, for messages.
std::vector<std::string> prior_folders(const PriorQuery& query);

// What its parts share.

/// Files below `folder` that end in one of `endings`, by the name of the view that they belong to:
/// by the view's name without its ending, by its last part where that is unique, or by the number
/// that both consist of. The first ending that any view has is taken. Names of views may end in
/// "_rgb", and keep their endings where `endings` go behind the whole name (`whole_names`).
PriorFiles match_priors(const std::string& folder,
                        const std::vector<std::string>& endings,
                        const std::vector<std::string>& views,
                        bool whole_names = false);

/// Of a folder with priors.json.
PriorSources read_priors_json(const std::string& folder, const std::vector<std::string>& views);

/// scale and offset per image of 3DGS's depth_params.json, put into `source`.
void read_depth_params(const std::string& path, DepthSource& source);

/// depth_file_path of transforms.json; empty where no frame has one.
DepthSource read_transforms_depth(const std::string& folder, const std::vector<std::string>& views);

}  // namespace tvsgs
