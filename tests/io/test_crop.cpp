#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>

#include "core/error.h"
#include "core/scene/crop.h"
#include "io/scene/crop_file.h"
#include "support/test_data.h"

namespace tvsgs {
namespace {

Crop parsed(const std::string& json) {
    const std::string path =
        testing::TempDir() + "tvsgs_crop_" + std::to_string(::getpid()) + ".json";
    std::ofstream(path) << json;
    struct Remove {
        std::string path;
        ~Remove() { std::remove(path.c_str()); }
    } remove{path};
    return read_crop(path);
}

TEST(Crop, Box) {
    const Crop crop = parsed(R"({"box": [[0, 0, 0], [1, 2, 3]]})");
    EXPECT_TRUE(contains(crop, {0.5, 1.5, 2.5}));
    EXPECT_TRUE(contains(crop, {1, 2, 3}));
    EXPECT_FALSE(contains(crop, {1.1, 1, 1}));
    EXPECT_FALSE(contains(crop, {std::nan(""), 1, 1}));
    EXPECT_TRUE(contains(Crop{}, {1e9, 0, 0}));
}

TEST(Crop, Cylinder) {
    const Crop crop = parsed(
        R"({"units": "mm", "crop_cylinder": {"center_xy": [1, 2], "radius": 3, "z_min": -1, "z_max": 4}})");
    EXPECT_TRUE(contains(crop, {1, 5, 4}));
    EXPECT_FALSE(contains(crop, {1, 5.01, 0}));
    EXPECT_FALSE(contains(crop, {3.2, 4.2, 0}));
    EXPECT_FALSE(contains(crop, {1, 2, 4.1}));
}

TEST(Crop, PrismWithANotch) {
    // An arrow head in the plane of x and z; the axis is y.
    const Crop crop = parsed(
        R"({"class_name": "SelectionPolygonVolume", "orthogonal_axis": "Y", "axis_min": 0, "axis_max": 1,
        "bounding_polygon": [[0, 0, 0], [4, 0, 0], [4, 0, 4], [2, 0, 1], [0, 0, 4]]})");
    EXPECT_TRUE(contains(crop, {0.5, 0.5, 2}));
    EXPECT_TRUE(contains(crop, {3.5, 0.5, 2}));
    EXPECT_FALSE(contains(crop, {2, 0.5, 2}));  // in the notch
    EXPECT_TRUE(contains(crop, {2, 0.5, 0.5}));
    EXPECT_FALSE(contains(crop, {2, 1.1, 0.5}));
    EXPECT_FALSE(contains(crop, {-1, 0.5, 1}));
    EXPECT_FALSE(contains(crop, {5, 0.5, 1}));
}

TEST(Crop, BadFiles) {
    for (
        const char* json :
        {"", "[]", "{}", R"({"box": [[0, 0, 0]]})", R"({"box": [[0, 0, 0], [1, "a", 1]]})",
         R"({"box": [[0, 0, 2], [1, 1, 1]]})",
         R"({"crop_cylinder": {"center_xy": [1], "radius": 3, "z_min": -1, "z_max": 4}})",
         R"({"crop_cylinder": 3})",
         R"({"crop_cylinder": {"center_xy": [1, 2], "radius": -3, "z_min": -1, "z_max": 4}})",
         R"({"class_name": "Other"})",
         R"({"class_name": "SelectionPolygonVolume", "axis_min": 0, "axis_max": 1, "bounding_polygon": [[0, 0, 0], [1, 0, 0]]})",
         R"({"class_name": "SelectionPolygonVolume", "axis_min": 1, "axis_max": 0, "bounding_polygon": [[0, 0, 0], [1, 0, 0], [1, 1, 0]]})",
         R"({"class_name": "SelectionPolygonVolume", "orthogonal_axis": 3, "axis_min": 0, "axis_max": 1, "bounding_polygon": []})"})
        try {
            parsed(json);
            ADD_FAILURE() << json;
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::input) << json;
            EXPECT_NE(std::string(error.what()).find("tvsgs_crop_"), std::string::npos)
                << error.what();
        }
    EXPECT_THROW(read_crop("/nonexistent/crop.json"), Error);
}

TEST(Crop, AStoredFile) {
    const Crop prism = read_crop(test_data("geometry/tnt_crop.json"));
    EXPECT_EQ(prism.polygon.size(), 5u);
    EXPECT_TRUE(contains(prism, {0.1, 0.5, 0}));
    EXPECT_FALSE(contains(prism, {0.5, 0.9, 0}));  // notch at (0.503, 0.704)
}

}  // namespace
}  // namespace tvsgs
