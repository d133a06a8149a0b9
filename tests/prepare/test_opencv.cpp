// The OpenCV functions of tvsgs-prepare: TIFF, calibrations, markers and videos.
#include <opencv2/aruco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "apps/prepare/opencv.h"
#include "apps/prepare/photographs.h"
#include "prepare/prepare_test.h"

namespace tvsgs::prepare {
namespace {

class OpenCv : public Prepare {};

TEST_F(OpenCv, TiffBecomesPngOfItsBits) {
    fs::create_directories(folder / "photos");
    cv::Mat wide(48, 64, CV_16UC3, cv::Scalar(0x0102, 0x8080, 0xFFFF));
    cv::imwrite((folder / "photos/a.tif").string(), wide);
    cv::imwrite((folder / "photos/b.TIFF").string(), cv::Mat(48, 64, CV_8UC1, cv::Scalar(77)));
    write("photos/c.tif", "no picture");
    expect_error(ExitCode::input, "c.tif: OpenCV cannot read it as an image of 8 or 16 bits",
                 [&] { find_photographs((folder / "photos").string()); });
    fs::remove(folder / "photos/c.tif");
    const std::vector<Photograph> photographs = find_photographs((folder / "photos").string());
    ASSERT_EQ(photographs.size(), 2u);
    EXPECT_EQ(photographs[0].name, "a.png");
    EXPECT_EQ(photographs[0].width, 64);
    put_photographs(photographs, (folder / "out").string());
    const ImageF a = read_image_numbers((folder / "out/a.png").string());
    EXPECT_EQ(a.at(3, 3, 0), 0xFFFF);  // red
    EXPECT_EQ(a.at(3, 3, 2), 0x0102);
    EXPECT_EQ(read_image((folder / "out/b.png").string(), 3).at(5, 5, 1), 77);
}

TEST_F(OpenCv, CalibrationsBecomeLenses) {
    const std::string yaml =
        "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\n"
        "camera_matrix: !!opencv-matrix\n  rows: 3\n  cols: 3\n  dt: d\n"
        "  data: [500, 0, 319.5, 0, 510, 239.5, 0, 0, 1]\n"
        "distortion_coefficients: !!opencv-matrix\n  rows: 1\n  cols: 5\n"
        "  dt: d\n  data: [-0.1, 0.03, 0.002, -0.003, 0.01]\n";
    const Calibration lens = read_calibration(write("lens.yml", yaml));
    EXPECT_EQ(lens.model, "FULL_OPENCV");
    EXPECT_EQ(lens.params,
              (std::vector<double>{500, 510, 320, 240, -0.1, 0.03, 0.002, -0.003, 0.01, 0, 0, 0}));
    EXPECT_EQ(lens.width, 640);
    // The same pixel as OpenCV's own projection, shifted by half a pixel.
    const Intrinsics in =
        make_intrinsics("lens", 1, *find_camera_model(lens.model), 640, 480, lens.params);
    std::vector<cv::Point2d> theirs;
    cv::projectPoints(std::vector<cv::Point3d>{{-0.6, 0.4, 1}}, cv::Vec3d(), cv::Vec3d(),
                      cv::Matx33d(500, 0, 319.5, 0, 510, 239.5, 0, 0, 1),
                      std::vector<double>{-0.1, 0.03, 0.002, -0.003, 0.01}, theirs);
    const Vec2<double> ours = distort(in.distortion, {-0.6, 0.4});
    EXPECT_NEAR(ours.x * in.fx_px + in.cx_px, theirs[0].x + 0.5, 1e-9);
    EXPECT_NEAR(ours.y * in.fy_px + in.cy_px, theirs[0].y + 0.5, 1e-9);

    EXPECT_EQ(read_calibration(write("fish.yml", yaml + "fisheye_model: 1\n")).model,
              "OPENCV_FISHEYE");
    expect_error(ExitCode::input, "expected camera_matrix",
                 [&] { read_calibration(write("none.json", "{\"a\": 1}")); });
    expect_error(ExitCode::input, "nowhere.yml", [] { read_calibration("nowhere.yml"); });

    // It is kept, scaled to the size of the photographs.
    photos({"a.png", "b.png"});
    store(0, made_model({"a.png", "b.png"}));
    const Result r = run("photos scene --calibration lens.yml");
    ASSERT_EQ(r.code, 0) << r;
    const std::string calls = text("calls.txt");
    EXPECT_NE(calls.find("--ImageReader.camera_params 50,51,32,24,-0.10000000000000001,"),
              std::string::npos)
        << calls;
    EXPECT_NE(calls.find("--Mapper.ba_refine_focal_length 0 --Mapper.ba_refine_extra_params 0"),
              std::string::npos);
    write("photos/a.png", png_bytes(ImageU8(64, 40, 3))),
        write("photos/b.png", png_bytes(ImageU8(64, 40, 3)));
    EXPECT_TRUE(run("photos other --calibration lens.yml").says("calibrated for 640x480 pixels"));
}

/// Image of a marker on a white floor: each pixel's ray meets z = 0 on the paper.
ImageU8 photo_of_marker(const Intrinsics& in,
                        const Rigid3d& pose,
                        const cv::Mat& paper,
                        double side) {
    ImageU8 photo(in.width_px, in.height_px, 3, 255);
    const Rigid3d world = inverse(pose);
    constexpr int kFine = 4;
    for (int y = 0; y < photo.height; ++y)
        for (int x = 0; x < photo.width; ++x) {
            double sum = 0;
            for (int k = 0; k < kFine * kFine; ++k) {
                const Vec2<double> uv = undistort(
                    in.distortion, {(x + (k % kFine + 0.5) / kFine - in.cx_px) / in.fx_px,
                                    (y + (k / kFine + 0.5) / kFine - in.cy_px) / in.fy_px});
                const Vec3d d = world.R * Vec3d{uv.x, uv.y, 1};
                const double t = -world.t.z / d.z;
                const double px = (world.t.x + t * d.x) / side + 0.5,
                             py = 0.5 - (world.t.y + t * d.y) / side;
                const bool inside = px >= 0 && py >= 0 && px < 1 && py < 1;
                sum += inside ? paper.at<std::uint8_t>(static_cast<int>(py * paper.rows),
                                                       static_cast<int>(px * paper.cols))
                              : 230;
            }
            for (int c = 0; c < 3; ++c)
                photo.at(x, y, c) = static_cast<std::uint8_t>(sum / (kFine * kFine));
        }
    return photo;
}

TEST_F(OpenCv, MarkersMakeTheSceneMetric) {
    // A tag of 0.2 m at the origin, upright in the image of a camera that looks along +y.
    cv::Mat paper;
    cv::aruco::drawMarker(cv::aruco::getPredefinedDictionary(cv::aruco::DICT_APRILTAG_36h11), 5, 80,
                          paper, 1);
    SparseModel model;
    model.cameras = {{1, 4, 400, 300, {420, 425, 200, 150, -0.1, 0.02, 0.001, -0.002}}};
    const Intrinsics in = intrinsics_of(model.cameras[0]);
    const Vec3d eyes[] = {{0, -0.7, 0.5}, {0.5, -0.5, 0.6}, {-0.4, -0.6, 0.7}};
    for (std::uint32_t i = 0; i < 3; ++i) {
        const Rigid3d pose = looking_from(eyes[i]);
        const std::string name = str(i, ".png");
        write("photos/" + name, png_bytes(photo_of_marker(in, pose, paper, 0.2)));
        model.images.push_back({i + 1, 1, quaternion(pose.R), pose.t, name, {}});
    }
    const Rigid3d first = looking_from(eyes[0]);
    const std::vector<Marker> markers =
        find_markers((folder / "photos/0.png").string(), "DICT_APRILTAG_36h11");
    ASSERT_EQ(markers.size(), 1u);
    EXPECT_EQ(markers[0].id, 5);
    const Vec3d corners[] = {{-0.1, 0.1, 0}, {0.1, 0.1, 0}, {0.1, -0.1, 0}, {-0.1, -0.1, 0}};
    for (int c = 0; c < 4; ++c) {
        const Vec2<double> place = project(in, first, corners[c]);
        EXPECT_NEAR(markers[0].corners[c].x, place.x, 0.5) << c;
        EXPECT_NEAR(markers[0].corners[c].y, place.y, 0.5) << c;
    }
    // COLMAP finds the same cameras in another frame.
    SparseModel other = model;
    move(other, {3.1, rotation(normalize(Quat<double>{0.8, 0.3, -0.4, 0.2})), {1, -2, 3}});
    store(0, other);
    const Result r = run("photos scene --marker-size 0.2 --marker-dictionary DICT_APRILTAG_36h11");
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_TRUE(r.says("Metric scale from 1 markers, seen 3 times")) << r;
    const SparseModel metric = read_sparse_model((folder / "scene/sparse/0").string());
    for (std::size_t i = 0; i < 3; ++i) {
        const Vec3d eye = inverse(metric.images[i].camera_from_world()).t;
        EXPECT_NEAR(norm(eye - eyes[i]), 0, 0.005) << i;  // half a pixel is 0.9 mm there
    }
    EXPECT_TRUE(run("photos x --marker-size 0.2 --marker-dictionary AR").says("DICT_4X4_50"));
    EXPECT_TRUE(run("photos x --marker-size 0.2").says("0 markers in 3 photographs"));
}

TEST_F(OpenCv, VideosGiveSharpFramesThatMoved) {
    // A window of 320x240 slides over a texture by 4 px a frame; every third frame is sharp.
    cv::Mat texture(240, 1600, CV_8UC3);
    cv::RNG random(3);
    random.fill(texture, cv::RNG::UNIFORM, 0, 255);
    cv::GaussianBlur(texture, texture, {}, 1.5);
    cv::normalize(texture, texture, 0, 255, cv::NORM_MINMAX);
    cv::VideoWriter out((folder / "walk.avi").string(), cv::VideoWriter::fourcc('M', 'J', 'P', 'G'),
                        25, {320, 240});
    ASSERT_TRUE(out.isOpened());
    constexpr int kFrames = 150;
    std::vector<cv::Mat> frames;
    for (int i = 0; i < kFrames; ++i) {
        cv::Mat frame = texture(cv::Rect(4 * i, 0, 320, 240)).clone();
        if (i % 3 != 0) cv::blur(frame, frame, {5, 1});
        frames.push_back(frame);
        out.write(frame);
    }
    out.release();
    fs::create_directories(folder / "frames");
    const int count =
        extract_frames((folder / "walk.avi").string(), (folder / "frames").string(), 100);
    // 596 px in steps of 8 to 18.
    EXPECT_GE(count, 33);
    EXPECT_LE(count, 75);
    int sharp = 0;
    for (const Photograph& photo : find_photographs((folder / "frames").string())) {
        const cv::Mat frame = cv::imread(photo.file);
        int nearest = 0;
        for (int i = 0; i < kFrames; ++i)
            if (cv::norm(frame, frames[static_cast<std::size_t>(i)], cv::NORM_L1) <
                cv::norm(frame, frames[static_cast<std::size_t>(nearest)], cv::NORM_L1))
                nearest = i;
        sharp += nearest % 3 == 0;
    }
    EXPECT_GE(sharp, count - 1);  // the last one can be the only choice
    fs::remove_all(folder / "frames");
    fs::create_directories(folder / "frames");
    EXPECT_EQ(extract_frames((folder / "walk.avi").string(), (folder / "frames").string(), 5), 5);
    expect_error(ExitCode::input, "cannot read it as a video",
                 [&] { extract_frames(write("no.avi", "no video"), folder.string(), 5); });

    // The whole command; the first frame is always selected.
    store(0, made_model({"frame_00000.jpg"}));
    const Result r = run("walk.avi scene --frames 5 --min-share 20");
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_TRUE(r.says("walk.avi: took 5 frames")) << r;
    EXPECT_NE(text("calls.txt").find("sequential_matcher"), std::string::npos);
}

}  // namespace
}  // namespace tvsgs::prepare
