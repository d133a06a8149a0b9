// RUN/cameras/: readers get the written poses, also far from the origin and at other sizes.
#include "io/io_test.h"
#include "pipeline/run/refined_cameras.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

class RefinedCameras : public IoTest {};

Scene scene_of(int width, int height, Vec3d origin) {
    Scene scene;
    scene.origin = origin;
    for (const char* name : {"a/0.png", "b c.png"}) {
        View view;
        view.name = name;
        view.camera = test::test_camera(width, height, scene.train.empty() ? 0.3f : -0.5f);
        scene.train.push_back(view);
    }
    return scene;
}

void expect_near_poses(const Camera& a, const Camera& b) {
    for (int r = 0; r < 3; ++r) {
        EXPECT_NEAR(a.camera_from_world.t[r], b.camera_from_world.t[r], 1e-6f);
        for (int c = 0; c < 3; ++c)
            EXPECT_NEAR(a.camera_from_world.R[r][c], b.camera_from_world.R[r][c], 1e-6f);
    }
}

TEST_F(RefinedCameras, AreReadAsTheyWereWritten) {
    for (const Vec3d origin : {Vec3d{}, Vec3d{4.5e5, 5.4e6, 300}}) {
        Scene written = scene_of(64, 48, origin);
        for (View& view : written.train) view.camera.camera_from_world.t.x += 0.03f;
        const std::string run = (folder / str(norm(origin))).string();
        write_refined_cameras(run, written);
        for (const int times : {1, 2}) {
            Scene read = scene_of(64 * times, 48 * times, origin);
            read.test = read.train;
            apply_refined_cameras(run, read);
            for (std::size_t i = 0; i < 2; ++i) {
                const Camera &is = read.train[i].camera, &given = read.test[i].camera;
                expect_near_poses(is, written.train[i].camera);
                EXPECT_EQ(is.cx_px, given.cx_px);
                EXPECT_EQ(is.fx_px, given.fx_px);
                EXPECT_NEAR(is.camera_from_world.t.x - given.camera_from_world.t.x, 0.03f, 1e-6f)
                    << "test views stay";
            }
        }
    }
}

TEST_F(RefinedCameras, OthersStayAndBrokenFilesAreErrors) {
    Scene scene = scene_of(64, 48, {});
    const Camera given = scene.train[0].camera;
    apply_refined_cameras(folder.string(), scene);  // a run without refined cameras
    EXPECT_EQ(scene.train[0].camera.fx_px, given.fx_px);

    Scene one = scene;
    one.train.erase(one.train.begin());
    one.train[0].camera.camera_from_world.t.x += 1;
    write_refined_cameras(folder.string(), one);
    apply_refined_cameras(folder.string(), scene);
    EXPECT_EQ(scene.train[0].camera.camera_from_world.t.x, given.camera_from_world.t.x);
    EXPECT_NEAR(scene.train[1].camera.camera_from_world.t.x,
                one.train[0].camera.camera_from_world.t.x, 1e-6f);

    write("cameras/images.txt", "1 1 0 0 nan 0 0 0 1 b c.png\n\n");
    expect_error(ExitCode::input, "E_POSE", [&] { apply_refined_cameras(folder.string(), scene); });
    std::filesystem::remove(folder / "cameras/cameras.txt");
    expect_error(ExitCode::input, "cameras",
                 [&] { apply_refined_cameras(folder.string(), scene); });
}

}  // namespace
}  // namespace tvsgs
