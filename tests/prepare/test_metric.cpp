// Transforming a model, and the metric frame of markers.
#include "apps/prepare/check.h"
#include "apps/prepare/photographs.h"
#include "apps/prepare/placement.h"
#include "io/scene/colmap.h"
#include "prepare/prepare_test.h"

namespace tvsgs::prepare {
namespace {

/// With a rotation about a skew axis.
Similarity some_similarity() {
    return {0.37, rotation(normalize(Quat<double>{0.8, 0.3, -0.4, 0.2})), {1, -2, 3}};
}

TEST(SparseModels, MovedTheyShowTheSame) {
    SparseModel model = made_model({"a", "b", "c"});
    move(model, some_similarity());
    const Intrinsics in = intrinsics_of(model.cameras[0]);
    for (const SparseImage& image : model.images)
        for (std::size_t i = 0; i < model.points.size(); ++i) {
            const Vec2<double> place =
                project(in, image.camera_from_world(), model.points[i].position);
            EXPECT_NEAR(place.x, image.observations[i].place.x, 1e-9);
            EXPECT_NEAR(place.y, image.observations[i].place.y, 1e-9);
        }
}

TEST(SparseModels, RicherLensesShowTheSameAtFirst) {
    const Vec2<double> ray{-0.4, 0.3};
    for (const bool fisheye : {false, true}) {
        const SparseCamera simple{1, fisheye ? 8 : 2, 64, 48, {70, 32, 24, -0.1}};
        const Vec2<double> before = distort(intrinsics_of(simple).distortion, ray);
        for (const std::string lens : {"RADIAL", "OPENCV", "FULL_OPENCV", "RADIAL_FISHEYE",
                                       "OPENCV_FISHEYE", "THIN_PRISM_FISHEYE"}) {
            SparseCamera camera = simple;
            EXPECT_EQ(take_lens(camera, lens), lens.ends_with("FISHEYE") == fisheye) << lens;
            const Vec2<double> after = distort(intrinsics_of(camera).distortion, ray);
            EXPECT_EQ(after.x, before.x) << lens;
            EXPECT_EQ(after.y, before.y) << lens;
        }
        SparseCamera other = simple;
        for (const char* lens : {"FOV", "PINHOLE", "SIMPLE_RADIAL", ""})
            EXPECT_FALSE(take_lens(other, lens)) << lens;
    }
}

class Files : public IoTest {};

TEST_F(Files, SparseModelsAreWrittenAndRead) {
    const SparseModel model = made_model({"a.png", "b c.png"});
    write_sparse_model(folder.string(), model);
    const SparseModel back = read_sparse_model(folder.string());
    ASSERT_EQ(back.images.size(), 2u);
    EXPECT_EQ(back.cameras[0].params, model.cameras[0].params);
    EXPECT_EQ(back.images[1].name, "b c.png");
    EXPECT_EQ(back.images[1].quat.z, model.images[1].quat.z);
    EXPECT_EQ(back.images[1].observations[20].point, kNoPoint);
    EXPECT_EQ(back.points[3].track, model.points[3].track);
    EXPECT_EQ(back.points[3].color, model.points[3].color);
    EXPECT_EQ(count_images(folder.string()), 2u);
    EXPECT_EQ(count_images((folder / "none").string()), 0u);
    // The reader of scenes reads the same.
    const ColmapModel other = read_colmap_model(folder.string());
    EXPECT_NEAR(other.images[1].camera_from_world.t.y, model.images[1].translation.y, 1e-12);
    EXPECT_EQ(read_colmap_points(folder.string()).positions.size(), 20u);
}

TEST_F(Files, PhotographsAreGroupedByWhatTheySay) {
    const auto jpeg = [&](const std::string& name, int width, const std::string& model, int focal) {
        // Big endian: model (at 38) and a list of details (at 50) with the focal length (at 68).
        std::string tiff(
            "MM\0\x2A\0\0\0\x08\0\2\x01\x10\0\2\0\0\0\x0C\0\0\0\x26\x87\x69\0\4\0\0\0\1\0\0\0\x32"
            "\0\0\0\0",
            38);
        std::string padded = model;
        padded.resize(12, '\0');
        tiff += padded;
        tiff += std::string("\0\1\x92\x0A\0\5\0\0\0\1\0\0\0\x44\0\0\0\0", 18);
        tiff += std::string("\0\0\0", 3) + static_cast<char>(focal) + std::string("\0\0\0\x0A", 4);
        const std::string exif = std::string("Exif\0\0", 6) + tiff;
        const std::string plain = jpeg_bytes(ImageU8(width, 16, 3, 50), 90);
        write(name, plain.substr(0, 2) + "\xFF\xE1" + std::string(1, '\0') +
                        static_cast<char>(exif.size() + 2) + exif + plain.substr(2));
    };
    jpeg("a.jpg", 24, "Phone 7", 45), jpeg("b.jpg", 24, "Phone 7", 45);
    jpeg("c.jpg", 24, "Phone 7", 90), jpeg("d.jpg", 32, "Phone 7", 45);
    const std::vector<Photograph> photographs = find_photographs(folder.string());
    ASSERT_EQ(photographs.size(), 4u);
    EXPECT_EQ(photographs[0].camera, "Phone 7 at 4.5 mm");
    const std::vector<CameraGroup> groups = group_by_camera(photographs, Sharing::automatic);
    ASSERT_EQ(groups.size(), 3u);
    EXPECT_EQ(groups[0].names, (std::vector<std::string>{"a.jpg", "b.jpg"}));
    EXPECT_EQ(groups[1].names, (std::vector<std::string>{"c.jpg"}));
    EXPECT_EQ(group_by_camera(photographs, Sharing::each).size(), 4u);
}

/// Squares of side 0.1 metres, seen by the cameras of made_model in a frame of another scale and
/// orientation, as COLMAP gives it.
struct MarkerCase {
    std::vector<MarkerView> views;
    std::vector<Vec3d> corners[2];  // in metres: of markers 4 and 9

    MarkerCase(Vec3d right, Vec3d down, Vec3d second_down) {
        const Vec3d middles[2] = {{0.3, 0.1, 0}, {-0.2, 0.4, 0}};
        for (int m = 0; m < 2; ++m) {
            const Vec3d r = 0.05 * right, d = 0.05 * (m == 0 ? down : second_down);
            corners[m] = {middles[m] - r - d, middles[m] + r - d, middles[m] + r + d,
                          middles[m] - r + d};
        }
        SparseModel model = made_model({"a", "b", "c"});
        const Intrinsics in = intrinsics_of(model.cameras[0]);
        std::vector<std::vector<Marker>> seen;
        for (const SparseImage& image : model.images) {
            std::vector<Marker> markers(2);
            for (int m = 0; m < 2; ++m) {
                markers[static_cast<std::size_t>(m)].id = m == 0 ? 4 : 9;
                for (std::size_t c = 0; c < 4; ++c)
                    markers[static_cast<std::size_t>(m)].corners[c] =
                        project(in, image.camera_from_world(), corners[m][c]);
            }
            seen.push_back(markers);
        }
        move(model, some_similarity());
        for (std::size_t i = 0; i < model.images.size(); ++i)
            views.push_back({in, model.images[i].camera_from_world(), seen[i]});
    }
    /// Position in the new frame of the point at `metric`.
    Vec3d found(const MetricFrame& frame, Vec3d metric) const {
        return frame.to_new * (some_similarity() * metric);
    }
};

TEST(Metric, MarkersOnTheFloorGiveMetresAndUp) {
    const Vec3d x{1, 0, 0}, y{0, 1, 0};
    const MarkerCase c(x, -y, -y);
    const MetricFrame frame = metric_frame(c.views, 0.1, false);
    EXPECT_EQ(frame.markers, 2);
    EXPECT_TRUE(frame.upright);
    EXPECT_NEAR(frame.spread, 0, 1e-9);
    EXPECT_NEAR(frame.to_new.scale * 0.37, 1, 1e-9);
    // The origin is the centre of marker 4, x along its upper edge, z out of the paper.
    const Vec3d p = c.found(frame, Vec3d{0.3, 0.1, 0} + Vec3d{0.02, 0.3, 0.7});
    EXPECT_NEAR(p.x, 0.02, 1e-9);
    EXPECT_NEAR(p.y, 0.3, 1e-9);
    EXPECT_NEAR(p.z, 0.7, 1e-9);
}

TEST(Metric, MarkersOnAWallStandUpright) {
    const Vec3d x{1, 0, 0}, down{0, 0, -1};
    const MarkerCase c(x, down, down);
    const MetricFrame frame = metric_frame(c.views, 0.1, true);
    EXPECT_TRUE(frame.upright);
    const Vec3d p = c.found(frame, Vec3d{0.3, 0.1, 0} + Vec3d{0, 0, 0.5});
    EXPECT_NEAR(p.z, 0.5, 1e-9);
    EXPECT_NEAR(p.x, 0, 1e-9);
}

TEST(Metric, MarkersThatDisagreeGiveMetresAlone) {
    const Vec3d x{1, 0, 0}, y{0, 1, 0};
    const MarkerCase c(x, -y, normalize(Vec3d{0, -1, 1}));
    const MetricFrame frame = metric_frame(c.views, 0.1, false);
    EXPECT_FALSE(frame.upright);
    EXPECT_NEAR(frame.to_new.scale * 0.37, 1, 1e-9);
    EXPECT_EQ(frame.to_new.t.x, 0);
}

TEST(Metric, WhatNoTwoPhotographsSeeIsNoMeasure) {
    const Vec3d x{1, 0, 0}, y{0, 1, 0};
    MarkerCase c(x, -y, -y);
    c.views.resize(1);
    expect_error(ExitCode::input, "2 markers in 1 photographs",
                 [&] { metric_frame(c.views, 0.1, false); });
    // Not a square: a corner was found in the wrong place.
    MarkerCase skew(x, -y, -y);
    for (MarkerView& view : skew.views) view.markers[1].corners[2].x += 3;
    EXPECT_EQ(metric_frame(skew.views, 0.1, false).markers, 1);
}

TEST(Checks, NarrowBaselinesAndResiduals) {
    const std::vector<std::string> names = {"a", "b", "c"};
    SparseModel model = made_model(names, 2);
    const Check check = check_models(names, {model}, {});
    EXPECT_NEAR(check.residual_px, 2, 1e-9);
    EXPECT_EQ(check.observations, 60u);
    EXPECT_NEAR(check.track_length, 3, 1e-12);
    EXPECT_GT(check.angle_deg, 15);
    model.images.pop_back();
    model.images[1].translation = model.images[0].translation + Vec3d{0.05, 0, 0};
    model.images[1].quat = model.images[0].quat;
    EXPECT_LT(check_models(names, {model}, {}).angle_deg, 1);
}

}  // namespace
}  // namespace tvsgs::prepare
