// The table of public models, in the code and in the guide.
#include "apps/priors/recipe.h"
#include "io/io_test.h"

namespace tvsgs::priors {
namespace {

TEST(Recipe, TheGuideHasTheTableOfTheCode) {
    const std::string guide = read_text(TVSGS_SOURCE_DIR "/docs/guide/priors.md");
    std::string table;
    for (const std::string& line : preset_table()) table += line + "\n";
    EXPECT_NE(guide.find(table), std::string::npos) << "docs/guide/priors.md has not this table:\n"
                                                    << table;
}

// What each model wants, as its authors say it: a slip in the table's code would go into the guide.
TEST(Recipe, PresetsAreWhatTheirAuthorsSay) {
    const Recipe any = find_preset("depth-anything-v2").recipe;
    EXPECT_EQ(any.mean, (std::array<double, 3>{0.485, 0.456, 0.406}));
    EXPECT_EQ(any.std, (std::array<double, 3>{0.229, 0.224, 0.225}));
    EXPECT_DOUBLE_EQ(any.scale, 1.0 / 255);
    EXPECT_EQ(any.quantity, PriorQuantity::inverse_depth);
    EXPECT_EQ(any.alignment, PriorAlignment::affine);
    const Recipe midas = find_preset("midas").recipe;
    EXPECT_EQ(midas.mean, (std::array<double, 3>{0, 0, 0}));
    EXPECT_EQ(midas.std, (std::array<double, 3>{1, 1, 1}));
    const Recipe metric3d = find_preset("metric3d").recipe;
    EXPECT_EQ(metric3d.scale, 1);
    EXPECT_EQ(metric3d.fit, Fit::pad);
    EXPECT_EQ(metric3d.quantity, PriorQuantity::depth);
    EXPECT_EQ(metric3d.alignment, PriorAlignment::scale);
    const Recipe normal = find_preset("omnidata-normal").recipe;
    EXPECT_EQ(normal.kind, MapKind::normal);
    EXPECT_TRUE(normal.unit_range);
    EXPECT_FALSE(normal.frame);
    EXPECT_EQ(find_preset("dinov2").recipe.patch, 14);
    for (const Preset& preset : presets()) EXPECT_FALSE(preset.recipe.bgr) << preset.name;
}

TEST(Recipe, TextsSayAllOfIt) {
    Recipe recipe;
    EXPECT_EQ(normalisation_of(recipe), "rgb / 255");
    EXPECT_EQ(text_of(recipe.size, recipe.fit), "of the file");
    recipe.bgr = true, recipe.scale = 1, recipe.fit = Fit::pad;
    recipe.mean = {104, 117, 123};
    EXPECT_EQ(normalisation_of(recipe), "bgr - (104, 117, 123)");
    recipe.scale = 0.3, recipe.std = {1, 2, 4};
    EXPECT_EQ(normalisation_of(recipe), "(bgr * 0.3 - (104, 117, 123)) / (1, 2, 4)");
    recipe.size = {InputSize::By::long_side, 0, 0, 512, 32};
    EXPECT_EQ(text_of(recipe.size, recipe.fit), "512 long, multiples of 32, padded");
    EXPECT_EQ(meaning_of(recipe), "what fits the points, affine");
    recipe.quantity = PriorQuantity::log_depth, recipe.geometry = PriorGeometry::ray;
    EXPECT_EQ(meaning_of(recipe), "log depth, affine, along the ray");
}

TEST(Recipe, AnUnknownPresetNamesTheNearest) {
    expect_error(ExitCode::usage, "did you mean depth-anything-v2?",
                 [] { find_preset("depth-anything-v1"); });
    expect_error(ExitCode::usage, "there are midas, dpt, depth-anything-v2,",
                 [] { find_preset("zoe"); });
}

}  // namespace
}  // namespace tvsgs::priors
