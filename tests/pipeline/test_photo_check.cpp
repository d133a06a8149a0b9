// Photographs that cannot show a surface are refused before the training.
#include <gtest/gtest.h>

#include "core/error.h"
#include "pipeline/scene/mask_use.h"

namespace tvsgs {
namespace {

View view_of(const std::string& name, int width, int height, int seed) {
    View view;
    view.name = name;
    view.photo = ImageU8(width, height, 3);
    for (std::size_t i = 0; i < view.photo.pixels.size(); ++i)
        view.photo.pixels[i] = static_cast<std::uint8_t>(seed == 0 ? 7 + i % 2 : i * seed % 251);
    return view;
}

std::string refusal(const std::vector<View>& views) {
    try {
        check_photographs(views);
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::input);
        return error.what();
    }
    return "";
}

TEST(CheckPhotographs, RefusesBlankRepeatedAndTinyOnes) {
    const View a = view_of("a.png", 80, 60, 3), b = view_of("b.png", 80, 60, 5),
               again = view_of("again.png", 80, 60, 3), black = view_of("black.png", 80, 60, 0),
               tiny = view_of("tiny.png", 80, 7, 3), small = view_of("small.png", 80, 8, 3);
    EXPECT_EQ(refusal({a, b}), "");
    EXPECT_EQ(refusal({small, b}), "");
    EXPECT_EQ(refusal({a}), "");
    EXPECT_EQ(refusal({}), "");
    EXPECT_EQ(refusal({a, again, b}), "") << "a warning";
    EXPECT_EQ(refusal({a, black}), "") << "a warning";
    EXPECT_NE(refusal({black, black}).find("all 2 training photographs are blank"),
              std::string::npos);
    EXPECT_NE(refusal({a, again, again}).find("again.png repeats a.png"), std::string::npos);
    EXPECT_NE(refusal({a, tiny}).find("tiny.png: 80x7 pixels"), std::string::npos);
}

/// Photographs that differ in a part only are not repeated.
TEST(CheckPhotographs, ComparesRowsFromTopToBottom) {
    const View a = view_of("a.png", 80, 300, 3);
    View b = view_of("b.png", 80, 300, 3);
    for (int y = 140; y < 160; ++y)
        for (int x = 0; x < 80; ++x) b.photo.at(x, y) ^= 1;
    EXPECT_EQ(refusal({a, b}), "");
}

std::string poses_refused(const std::vector<double>& errors) {
    std::vector<View> views;
    for (const double error : errors) {
        views.push_back(view_of("a.png", 80, 60, 3));
        views.back().camera.width_px = 80, views.back().pose_error_px = error;
    }
    try {
        check_poses("SCENE", views);
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::input);
        return error.what();
    }
    return "";
}

TEST(CheckPoses, RefusesPosesThatThePointsContradict) {
    EXPECT_EQ(poses_refused({0.1, NAN, 3}), "");
    EXPECT_EQ(poses_refused({12, 12, 3, 3}), "") << "half of them";
    EXPECT_EQ(poses_refused({12, NAN, NAN}), "") << "the others are not known";
    EXPECT_NE(poses_refused({12, 12, 3}).find("in 2 of 3 training photographs"), std::string::npos);
    EXPECT_NE(poses_refused({INFINITY, INFINITY}).find("in 2 of 2"), std::string::npos);
}

TEST(CheckMasks, OneNeedsThePixelsOfAnObject) {
    MaskLook look;
    require_some_object(look);
    look.masked = look.empties = 3;
    EXPECT_THROW(require_some_object(look), Error);
    look.empties = 2;
    require_some_object(look);
}

}  // namespace
}  // namespace tvsgs
