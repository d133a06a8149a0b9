// How a photograph becomes a network's input, and what the numbers of its output mean. Nothing in
// an ONNX file says so.  [docs/guide/priors.md#with-a-network-of-your-own]
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "core/prior_conventions.h"

namespace tvsgs::priors {

enum class MapKind { depth, normal, features };
const char* name_of(MapKind kind);

/// The size of the input: as the file fixes it, width x height, or by one side of the photograph.
struct InputSize {
    enum class By { file, both, long_side, short_side } by = By::file;
    int width = 0, height = 0;  // both
    int side = 0;               // long_side, short_side
    int multiple = 1;           // sides are rounded to that; not those of `both`
};

/// stretch: the photograph fills the input, in another shape where need be. pad: it keeps its shape
/// and stands in the middle.
enum class Fit { stretch, pad };

struct Recipe {
    MapKind kind = MapKind::depth;
    InputSize size;
    Fit fit = Fit::stretch;
    bool bgr = false;
    /// Channel c of the input is (scale * p - mean[c]) / std[c] for p of 0 to 255, in its order.
    double scale = 1.0 / 255;
    std::array<double, 3> mean{0, 0, 0}, std{1, 1, 1};
    std::string output;  // empty: the only one
    int patch = 0;       // features: the output is tokens [1, n, channels] of patches that large

    // depth
    PriorQuantity quantity = PriorQuantity::unknown;
    PriorGeometry geometry = PriorGeometry::unknown;
    PriorAlignment alignment = PriorAlignment::affine;
    // normal
    std::optional<NormalFrame> frame;  // none: found by the scene's points
    bool facing_away = false;
    bool unit_range = false;  // numbers are (n + 1) / 2
};

/// A public model.
struct Preset {
    const char* name;
    const char* model;
    const char* file;     // the ONNX file, or where it comes from
    const char* license;  // of the weights
    Recipe recipe;
};
const std::vector<Preset>& presets();

/// Throws Error(ExitCode::usage) that names the nearest one.
const Preset& find_preset(const std::string& name);

/// "518 long, multiples of 14", "384x384, padded", "of the file"
std::string text_of(const InputSize& size, Fit fit);

/// "rgb / 255", "(rgb / 255 - (0.5, 0.5, 0.5)) / (0.5, 0.5, 0.5)"
std::string normalisation_of(const Recipe& recipe);

/// "inverse depth, affine", "normals, (n + 1) / 2", "tokens of 14x14 pixels"
std::string meaning_of(const Recipe& recipe);

/// The presets as a table in Markdown, which the guide shows; one line each.
std::vector<std::string> preset_table();

}  // namespace tvsgs::priors
