#include "apps/priors/recipe.h"

#include <cmath>

#include "core/error.h"
#include "core/nearest_name.h"

namespace tvsgs::priors {
namespace {

constexpr std::array<double, 3> kImageNetMean{0.485, 0.456, 0.406},
    kImageNetStd{0.229, 0.224, 0.225}, kHalf{0.5, 0.5, 0.5};

InputSize fixed(int width, int height) {
    InputSize size;
    size.by = InputSize::By::both, size.width = width, size.height = height;
    return size;
}

InputSize sides(InputSize::By by, int side, int multiple) {
    InputSize size;
    size.by = by, size.side = side, size.multiple = multiple;
    return size;
}

Recipe depth_recipe(const InputSize& size,
                    const std::array<double, 3>& mean,
                    const std::array<double, 3>& std,
                    PriorQuantity quantity,
                    PriorAlignment alignment) {
    Recipe recipe;
    recipe.size = size;
    recipe.mean = mean, recipe.std = std;
    recipe.quantity = quantity, recipe.alignment = alignment;
    return recipe;
}

/// By the authors' pages and export scripts. MiDaS's release file and Metric3D's export normalise
/// by themselves; normals are left to the scene's points where their frame is not stated.
std::vector<Preset> make_presets() {
    using enum PriorQuantity;
    using enum PriorAlignment;
    using By = InputSize::By;
    constexpr std::array<double, 3> kNone{0, 0, 0}, kOnes{1, 1, 1};
    // Metric3D's metres are those of a camera of 1000 pixels: an unknown unit for each photograph.
    Recipe metric3d = depth_recipe(fixed(1064, 616), kNone, kOnes, depth, scale);
    metric3d.scale = 1, metric3d.fit = Fit::pad;
    Recipe omnidata_normal;
    omnidata_normal.kind = MapKind::normal;
    omnidata_normal.size = fixed(384, 384), omnidata_normal.unit_range = true;
    Recipe dinov2 =
        depth_recipe(sides(By::long_side, 518, 14), kImageNetMean, kImageNetStd, unknown, affine);
    dinov2.kind = MapKind::features, dinov2.patch = 14;
    return {
        {"midas", "MiDaS v2.1", "`model-f6b98070.onnx` of its release v2_1", "MIT",
         depth_recipe(fixed(384, 384), kNone, kOnes, inverse_depth, affine)},
        {"dpt", "MiDaS 3.0 DPT-Large", "`Xenova/dpt-large`", "Apache-2.0",
         depth_recipe(fixed(384, 384), kHalf, kHalf, inverse_depth, affine)},
        {"depth-anything-v2", "Depth Anything V2", "`onnx-community/depth-anything-v2-small`",
         "small Apache-2.0, others CC BY-NC 4.0",
         depth_recipe(sides(By::short_side, 518, 14), kImageNetMean, kImageNetStd, inverse_depth,
                      affine)},
        {"depth-anything-v2-metric", "Depth Anything V2, metric", "its `metric_depth`, exported",
         "small Apache-2.0, others CC BY-NC 4.0",
         depth_recipe(sides(By::short_side, 518, 14), kImageNetMean, kImageNetStd, depth, scale)},
        {"metric3d", "Metric3D v2", "its `onnx/`, or `onnx-community/metric3d-vit-small`",
         "of the code BSD-2-Clause", metric3d},
        {"omnidata-depth", "Omnidata v2 depth", "`omnidata_dpt_depth_v2`, exported", "CC BY-NC 4.0",
         depth_recipe(fixed(384, 384), kHalf, kHalf, depth, affine)},
        {"omnidata-normal", "Omnidata v2 normals", "`omnidata_dpt_normal_v2`, exported",
         "CC BY-NC 4.0", omnidata_normal},
        {"dinov2", "DINOv2", "`Xenova/dinov2-base`", "Apache-2.0", dinov2},
    };
}

std::string triple(const std::array<double, 3>& v) {
    return str("(", v[0], ", ", v[1], ", ", v[2], ")");
}

}  // namespace

const char* name_of(MapKind kind) {
    return kind == MapKind::depth ? "depth" : kind == MapKind::normal ? "normal" : "features";
}

const std::vector<Preset>& presets() {
    static const std::vector<Preset> kPresets = make_presets();
    return kPresets;
}

const Preset& find_preset(const std::string& name) {
    std::vector<std::string> names;
    std::string known;
    for (const Preset& preset : presets()) {
        if (preset.name == name) return preset;
        names.push_back(preset.name);
        known += str(known.empty() ? "" : ", ", preset.name);
    }
    const std::string near = nearest_name(name, names);
    throw Error(ExitCode::usage,
                str("--preset ", name, ": there is none of that name",
                    near.empty() ? "" : str("; did you mean ", near, "?"), "; there are ", known,
                    ", or none, with --kind and what else the network wants"));
}

std::string text_of(const InputSize& size, Fit fit) {
    std::string text = size.by == InputSize::By::both         ? str(size.width, "x", size.height)
                       : size.by == InputSize::By::long_side  ? str(size.side, " long")
                       : size.by == InputSize::By::short_side ? str(size.side, " short")
                                                              : "of the file";
    if (size.multiple > 1) text += str(", multiples of ", size.multiple);
    return text + (fit == Fit::pad ? ", padded" : "");
}

std::string normalisation_of(const Recipe& recipe) {
    std::string text = recipe.bgr ? "bgr" : "rgb";
    const double divisor = 1 / recipe.scale;
    if (recipe.scale != 1)
        text += std::abs(divisor - std::round(divisor)) < 1e-9 ? str(" / ", std::round(divisor))
                                                               : str(" * ", recipe.scale);
    const bool shifted = recipe.mean != std::array<double, 3>{0, 0, 0};
    if (shifted) text += " - " + triple(recipe.mean);
    if (recipe.std != std::array<double, 3>{1, 1, 1})
        text = (shifted ? "(" + text + ")" : text) + " / " + triple(recipe.std);
    return text;
}

std::string meaning_of(const Recipe& recipe) {
    if (recipe.kind == MapKind::depth) {
        std::string quantity = tvsgs::name_of(recipe.quantity);
        for (char& c : quantity)
            if (c == '_') c = ' ';
        if (recipe.quantity == PriorQuantity::unknown) quantity = "what fits the points";
        return str(quantity, ", ", tvsgs::name_of(recipe.alignment),
                   recipe.geometry == PriorGeometry::ray ? ", along the ray" : "");
    }
    if (recipe.kind == MapKind::normal)
        return recipe.unit_range ? "normals, (n + 1) / 2" : "normals";
    return recipe.patch > 0 ? str("tokens of ", recipe.patch, "x", recipe.patch, " pixels")
                            : "features";
}

std::vector<std::string> preset_table() {
    std::vector<std::string> lines{
        "| preset | model | ONNX file | input | normalisation | numbers "
        "| weights |",
        "| --- | --- | --- | --- | --- | --- | --- |"};
    for (const Preset& p : presets())
        lines.push_back(str("| `", p.name, "` | ", p.model, " | ", p.file, " | ",
                            text_of(p.recipe.size, p.recipe.fit), " | ", normalisation_of(p.recipe),
                            " | ", meaning_of(p.recipe), " | ", p.license, " |"));
    return lines;
}

}  // namespace tvsgs::priors
