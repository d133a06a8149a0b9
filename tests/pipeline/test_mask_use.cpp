// Unusable masks are rejected, and the initial cloud is limited to the object.
#include <gtest/gtest.h>

#include <cmath>

#include "core/error.h"
#include "pipeline/run/splat_selection.h"
#include "pipeline/run/train_evaluation.h"
#include "pipeline/scene/mask_use.h"
#include "pipeline/scene/planned_scene.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

/// A view along z of the object, a square of 20 pixels in the middle of 60 by 60.
View masked_view(const std::string& name) {
    View view;
    view.name = name;
    view.camera = {60, 60, 60, 60, 30, 30, {}};
    view.camera.camera_from_world.R = rotation(Quatf{1, 0, 0, 0});
    view.camera.camera_from_world.t = {0, 0, 6};
    view.mask = ImageU8(60, 60, 1);
    for (int y = 20; y < 40; ++y)
        for (int x = 20; x < 40; ++x) view.mask.at(x, y) = 255;
    return view;
}

std::string refusal(MaskUse use, const std::vector<View>& views) {
    try {
        PhotometricOptions options;
        options.masks = use;
        check_masks(options, views);
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::input);
        return error.what();
    }
    return "";
}

TEST(CheckMasks, RefusesWhatCannotBeMeant) {
    const View good = masked_view("good.png");
    View black = masked_view("black.png"), none = masked_view("none.png");
    for (std::uint8_t& value : black.mask.pixels) value = value > 0 ? 1 : 0;  // 0 and 1
    none.mask = {};
    for (const MaskUse use : {MaskUse::object, MaskUse::ignore}) {
        EXPECT_EQ(refusal(use, {good, good}), "");
        EXPECT_EQ(refusal(use, {good, none}), "") << "a warning";
        EXPECT_NE(refusal(use, {good, black}).find("black.png"), std::string::npos);
        EXPECT_NE(refusal(use, {none, none}).find("no training view has a mask"),
                  std::string::npos);
    }
    for (const MaskUse use : {MaskUse::none, MaskUse::automatic})
        EXPECT_EQ(refusal(use, {none, black}), "");
    View lens = good;
    for (std::uint8_t& value : lens.mask.pixels) value = value > 0 ? 255 : kNoPhoto;
    EXPECT_NE(refusal(MaskUse::object, {lens, lens}).find("cover the photographs completely"),
              std::string::npos);
    EXPECT_EQ(refusal(MaskUse::object, {lens, good}), "");
    EXPECT_EQ(refusal(MaskUse::ignore, {lens, lens}), "");
}

TEST(CheckMasks, ARandomBackgroundIsForObjects) {
    const std::vector<View> views{masked_view("a.png")};
    for (const MaskUse use :
         {MaskUse::automatic, MaskUse::none, MaskUse::ignore, MaskUse::object}) {
        PhotometricOptions options;
        options.masks = use, options.background = "random";
        if (use == MaskUse::object)
            EXPECT_NO_THROW(check_masks(options, views));
        else
            EXPECT_THROW(check_masks(options, views), Error) << static_cast<int>(use);
    }
}

TEST(KeepToObject, OnlyWhereMasksAreOfOne) {
    const std::vector<View> views{masked_view("a.png")};
    for (const MaskUse use :
         {MaskUse::automatic, MaskUse::none, MaskUse::ignore, MaskUse::object}) {
        PointCloud cloud;
        cloud.positions = {{0, 0, 0}, {0, -2.5f, 0}}, cloud.colors.resize(2);
        limit_to_object(use, views, cloud);
        EXPECT_EQ(cloud.positions.size(), use == MaskUse::object ? 1u : 2u);
    }
}

/// A pixel is 0.1 wide at the depth of the points.
TEST(DropBackgroundPoints, UpToAPixelBesideTheObject) {
    PointCloud cloud;
    cloud.positions = {{0, 0, 0},     {1.05f, 0, 0}, {1.15f, 0, 0},
                       {0, -2.5f, 0}, {9, 0, 0},     {0, 0, -9}};
    cloud.colors.resize(6);
    EXPECT_EQ(drop_background_points({masked_view("a")}, cloud), 2u);
    ASSERT_EQ(cloud.positions.size(), 4u);
    EXPECT_EQ(cloud.colors.size(), 4u);
    EXPECT_EQ(cloud.positions[1].x, 1.05f);
    EXPECT_EQ(cloud.positions[2].x, 9) << "in no view, so nothing is known of it";
    View white = masked_view("b"), lens = white, none = white;
    for (std::uint8_t& value : white.mask.pixels) value = 255;
    for (std::uint8_t& value : lens.mask.pixels) value = kNoPhoto;
    none.mask = {};
    EXPECT_EQ(drop_background_points({white, lens, none}, cloud), 0u);
}

TEST(StereoOptions, HaveMasksWhereTrainingHas) {
    RunOptions options;
    EXPECT_FALSE(stereo_options(options).use_masks);
    options.train.loss.photometric.masks = MaskUse::ignore;
    EXPECT_TRUE(stereo_options(options).use_masks);
    options.train.loss.photometric.masks = MaskUse::none;
    options.stereo.use_masks = true;
    EXPECT_TRUE(stereo_options(options).use_masks);
}

TEST(PsnrTrained, IsOfTheWholeImageWhereNoMaskHasAnObject) {
    ViewScores scores;
    scores.mean_psnr = 20, scores.mean_masked.psnr = 30;
    TrainOptions options;
    EXPECT_EQ(psnr_trained(scores, options), 20);
    options.loss.photometric.masks = MaskUse::object;
    EXPECT_EQ(psnr_trained(scores, options), 30);
    scores.mean_masked.psnr = std::nan("");
    EXPECT_EQ(psnr_trained(scores, options), 20);
    View empty = masked_view("a");
    EXPECT_TRUE(has_object({empty}));
    for (std::uint8_t& value : empty.mask.pixels) value = value > 0 ? kNoPhoto : 0;
    EXPECT_FALSE(has_object({empty}));
}

TEST(CompareRenders, BeforeTheBackgroundOfTheRun) {
    View view = masked_view("a");
    view.photo = ImageU8(60, 60, 3, 250);
    Gaussians<Cpu> behind;  // behind the camera: only the background is visible
    resize(behind, 1, 0);
    behind.means.data()[0] = {0, 0, -20}, behind.quats.data()[0] = {1, 0, 0, 0};
    TrainOptions options;
    options.loss.photometric.background = "white";
    EXPECT_NEAR(compare_renders<Cpu>(behind, behind, {view}, options).before,
                20 * std::log10(255 / 5.0), 1e-3);
    options.loss.photometric.background = "none";
    EXPECT_LT(compare_renders<Cpu>(behind, behind, {view}, options).before, 1);
}

}  // namespace
}  // namespace tvsgs
