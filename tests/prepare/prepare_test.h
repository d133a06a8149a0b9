// A synthetic reconstruction for the tests of tvsgs-prepare, and a replacement for COLMAP that
// returns it.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "apps/prepare/sparse_model.h"
#include "core/math/rigid.h"
#include "io/files/json_value.h"
#include "io/io_test.h"
#include "support/command.h"

namespace tvsgs::prepare {

namespace fs = std::filesystem;

/// A camera at `eye` that looks at the origin; z is up.
inline Rigid3d looking_from(Vec3d eye) {
    const Vec3d z = normalize(-eye), x = normalize(cross(z, Vec3d{0, 0, 1})), y = cross(z, x);
    Rigid3d pose;
    for (int c = 0; c < 3; ++c) pose.R[0][c] = x[c], pose.R[1][c] = y[c], pose.R[2][c] = z[c];
    pose.t = -(pose.R * eye);
    return pose;
}

/// Image position of a world point.
inline Vec2<double> project(const Intrinsics& in, const Rigid3d& pose, Vec3d point) {
    const Vec3d p = pose * point;
    const Vec2<double> uv = distort(in.distortion, {p.x / p.z, p.y / p.z});
    return {uv.x * in.fx_px + in.cx_px, uv.y * in.fy_px + in.cy_px};
}

inline const std::vector<std::string> kNames = {"IMG_1.JPG", "IMG_2.JPG", "IMG_3.JPG", "b/1.png",
                                                "b/2.png"};

/// Cameras 10 degrees apart on a circle of radius 5 around 20 points near the origin, which all of
/// them see; observations are shifted by `miss_px` along x.
inline SparseModel made_model(const std::vector<std::string>& names, double miss_px = 0) {
    SparseModel model;
    model.cameras = {{1, 4, 64, 48, {70, 71, 32, 24, -0.1, 0.02, 0.001, -0.002}}};
    const Intrinsics in = intrinsics_of(model.cameras[0]);
    for (std::uint64_t i = 0; i < 20; ++i) {
        const double a = 2.4 * double(i), r = 0.1 * std::sqrt(double(i));
        model.points.push_back(
            {i + 7, {r * std::cos(a), r * std::sin(a), 0.03 * double(i)}, {10, 200, 30}, 0.5, {}});
    }
    for (std::uint32_t k = 0; k < names.size(); ++k) {
        const double azimuth = k * 0.17453292519943295;
        const Rigid3d pose = looking_from({5 * std::cos(azimuth), 5 * std::sin(azimuth), 2});
        SparseImage image;
        image.id = k + 3, image.camera_id = 1, image.name = names[k];
        image.quat = quaternion(pose.R), image.translation = pose.t;
        for (SparsePoint& point : model.points) {
            Vec2<double> place = project(in, pose, point.position);
            place.x += miss_px;
            point.track.emplace_back(image.id,
                                     static_cast<std::uint32_t>(image.observations.size()));
            image.observations.push_back({place, point.id});
        }
        image.observations.push_back({{1, 2}, kNoPoint});
        model.images.push_back(image);
    }
    return model;
}

/// Runs tvsgs-prepare with a `colmap` that logs its arguments, knows the options of the version in
/// the file version (3.8), and returns models that the test has stored.
class Prepare : public IoTest {
protected:
    void SetUp() override {
        IoTest::SetUp();
        write("bin/colmap", read_bytes(test_data("prepare/colmap")));
        fs::permissions(folder / "bin/colmap", fs::perms::owner_all);
    }

    /// `before`: words before the command.
    Result run(const std::string& arguments, const std::string& before = "") const {
        return run_script(folder, "PATH=$PWD/bin:/usr/bin:/bin " + before +
                                      " " TVSGS_BIN_DIR "/tvsgs-prepare " + arguments +
                                      " >out.txt 2>err.txt");
    }
    JsonValue report() const {
        return parse_json_value(text("scene/prepare.json"), "prepare.json");
    }
    /// Photographs of 64x48 pixels.
    void photo(const std::string& name) const {
        const ImageU8 image(64, 48, 3, 90);
        const std::string extension = fs::path(name).extension();
        write("photos/" + name, extension == ".png" ? png_bytes(image) : jpeg_bytes(image, 90));
    }
    void photos(const std::vector<std::string>& names) const {
        for (const std::string& name : names) photo(name);
    }
    void store(int number, const SparseModel& model) const {
        write_sparse_model((folder / "models" / str(number)).string(), model);
    }
    std::string text(const std::string& name) const {
        return fs::exists(folder / name) ? read_bytes((folder / name).string()) : "";
    }
    /// No scene, and no partial files.
    void expect_nothing_left() const {
        EXPECT_FALSE(fs::exists(folder / "scene"));
        for (const auto& entry : fs::directory_iterator(folder))
            EXPECT_FALSE(entry.path().filename().string().starts_with(".scene")) << entry.path();
    }
};

}  // namespace tvsgs::prepare
