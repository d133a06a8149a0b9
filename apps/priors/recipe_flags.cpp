#include "apps/priors/recipe_flags.h"

#include <algorithm>
#include <utility>

#include "apps/common/command_line.h"
#include "io/read_file.h"

namespace tvsgs::priors {
namespace {

constexpr int kMaxSide = 8192;

/// The place of `word` among `words`, which the command line has made sure of.
int place_of(const std::string& word, std::initializer_list<const char*> words) {
    return static_cast<int>(std::find(words.begin(), words.end(), word) - words.begin());
}

std::array<double, 3> triple(const std::vector<double>& v) {
    return {v[0], v[1], v[2]};
}

}  // namespace

void RecipeFlags::add_to(CLI::App& app) {
    const char* group = "Network";
    const auto choice = [&](const char* name, std::string& to, const char* help,
                            const std::vector<std::string>& words) {
        app.add_option(name, to, help)->check(CLI::IsMember(words))->group(group);
    };
    app.add_option("--preset", preset_, "a public model of --list-presets; flags go before it")
        ->group(group);
    choice("--kind", kind_, "what it gives", {"depth", "normal", "features"});
    app.add_option("--output", output_, "name of the output, where there are several")
        ->group(group);

    group = "Its input";
    app.add_option("--size", size_, "WIDTHxHEIGHT [as the file fixes it]")->group(group);
    app.add_option("--long-side", long_side_, "longer side, in the photograph's shape")
        ->check(CLI::Range(1, kMaxSide))
        ->group(group);
    app.add_option("--short-side", short_side_, "shorter side, in the photograph's shape")
        ->check(CLI::Range(1, kMaxSide))
        ->group(group);
    app.add_option("--multiple", multiple_, "sides are rounded to multiples of that [1]")
        ->check(CLI::Range(1, 1024))
        ->group(group);
    choice("--fit", fit_, "stretch the photograph to the size, or pad it [stretch]",
           {"stretch", "pad"});
    choice("--order", order_, "of the colours [rgb]", {"rgb", "bgr"});
    app.add_option("--scale", scale_, "factor of the numbers 0 to 255 [1/255]")
        ->check(kPositive)
        ->group(group);
    app.add_option("--mean", mean_, "A,B,C taken off after that, in that order of colours [0,0,0]")
        ->delimiter(',')
        ->expected(3)
        ->group(group);
    app.add_option("--std", std_, "A,B,C divided by then [1,1,1]")
        ->delimiter(',')
        ->expected(3)
        ->check(kPositive)
        ->group(group);

    group = "Its output";
    choice("--quantity", quantity_, "of depth: what the numbers are; auto: what fits the points",
           {"auto", "depth", "inverse_depth", "log_depth"});
    choice("--alignment", alignment_,
           "of depth: scene units, an unknown unit, also an unknown shift, order alone [affine]",
           {"metric", "scale", "affine", "rank"});
    choice("--geometry", geometry_, "of depth: along the optical axis or the ray [auto]",
           {"auto", "z", "ray"});
    choice("--frame", frame_, "of normals; auto: what fits the points [auto]",
           {"auto", "camera_opencv", "camera_opengl", "world"});
    choice("--facing", facing_, "of normals: to the camera or away; needs --frame [camera]",
           {"camera", "away"});
    choice("--range", range_, "of normals: signed, in [-1, 1], or unit, as (n + 1) / 2 [signed]",
           {"signed", "unit"});
    app.add_option("--patch", patch_, "of features: the output is tokens of patches that large")
        ->check(CLI::Range(1, 1024))
        ->group(group);
}

/// What is said of another kind of map is a slip.
void RecipeFlags::require_fitting(MapKind kind) const {
    const auto refuse = [&](bool given, const char* flag, MapKind of) {
        if (given && kind != of)
            throw Error(ExitCode::usage,
                        str(flag, " is for --kind ", name_of(of), ", not for ", name_of(kind)));
    };
    refuse(!quantity_.empty(), "--quantity", MapKind::depth);
    refuse(!alignment_.empty(), "--alignment", MapKind::depth);
    refuse(!geometry_.empty(), "--geometry", MapKind::depth);
    refuse(!frame_.empty(), "--frame", MapKind::normal);
    refuse(!facing_.empty(), "--facing", MapKind::normal);
    refuse(!range_.empty(), "--range", MapKind::normal);
    refuse(patch_ > 0, "--patch", MapKind::features);
}

void RecipeFlags::set_size(Recipe& recipe) const {
    if (side_flags() + (size_.empty() ? 0 : 1) > 1)
        throw Error(ExitCode::usage, "expected one of --size, --long-side and --short-side");
    InputSize& size = recipe.size;
    if (!size_.empty()) {
        const std::size_t x = size_.find('x');
        size = {};
        size.by = InputSize::By::both;
        if (x == std::string::npos || !parse_number(size_.substr(0, x), size.width) ||
            !parse_number(size_.substr(x + 1), size.height) || size.width < 1 || size.height < 1 ||
            size.width > kMaxSide || size.height > kMaxSide)
            throw Error(ExitCode::usage, str("--size ", size_,
                                             ": expected WIDTHxHEIGHT, as "
                                             "384x288, of at most ",
                                             kMaxSide, " a side"));
    } else if (side_flags() > 0) {
        const int multiple = size.multiple;
        size = {};
        size.by = long_side_ > 0 ? InputSize::By::long_side : InputSize::By::short_side;
        size.side = std::max(long_side_, short_side_), size.multiple = multiple;
    }
    if (multiple_ == 0) return;
    if (size.by == InputSize::By::both || size.by == InputSize::By::file)
        throw Error(ExitCode::usage, "--multiple goes with --long-side or --short-side");
    size.multiple = multiple_;
}

Recipe RecipeFlags::recipe() const {
    Recipe recipe;
    if (!preset_.empty()) recipe = find_preset(preset_).recipe;
    if (preset_.empty() && kind_.empty())
        throw Error(ExitCode::usage,
                    "what the network gives is not said; expected --kind depth, normal or "
                    "features, or a --preset; see --help");
    if (!kind_.empty()) {
        const auto kind = static_cast<MapKind>(place_of(kind_, {"depth", "normal", "features"}));
        if (!preset_.empty() && kind != recipe.kind)
            throw Error(ExitCode::usage, str("--preset ", preset_, " gives ", name_of(recipe.kind),
                                             ", --kind asks for ", kind_));
        recipe.kind = kind;
    }
    require_fitting(recipe.kind);
    set_size(recipe);
    if (!fit_.empty()) recipe.fit = fit_ == "pad" ? Fit::pad : Fit::stretch;
    if (!order_.empty()) recipe.bgr = order_ == "bgr";
    if (scale_ > 0) recipe.scale = scale_;
    if (!mean_.empty()) recipe.mean = triple(mean_);
    if (!std_.empty()) recipe.std = triple(std_);
    if (!output_.empty()) recipe.output = output_;
    if (patch_ > 0) recipe.patch = patch_;
    if (!quantity_.empty())
        recipe.quantity = static_cast<PriorQuantity>(
            place_of(quantity_, {"auto", "depth", "inverse_depth", "log_depth"}));
    if (!alignment_.empty())
        recipe.alignment = static_cast<PriorAlignment>(
            place_of(alignment_, {"metric", "scale", "affine", "rank"}));
    if (!geometry_.empty())
        recipe.geometry = static_cast<PriorGeometry>(place_of(geometry_, {"auto", "z", "ray"}));
    if (frame_ == "auto") recipe.frame.reset();
    if (!frame_.empty() && frame_ != "auto")
        recipe.frame =
            static_cast<NormalFrame>(place_of(frame_, {"camera_opencv", "camera_opengl", "world"}));
    if (!facing_.empty()) {
        if (!recipe.frame)
            throw Error(ExitCode::usage, "--facing needs a --frame; without one both are found");
        recipe.facing_away = facing_ == "away";
    }
    if (!range_.empty()) recipe.unit_range = range_ == "unit";
    return recipe;
}

}  // namespace tvsgs::priors
