// tvsgs-prepare, with a replacement for COLMAP.
#include <fcntl.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <functional>

#include "core/log.h"
#include "io/images/image_file.h"
#include "io/scene/georeference.h"
#include "io/scene/scene_reader.h"
#include "prepare/prepare_test.h"

namespace tvsgs::prepare {
namespace {

TEST_F(Prepare, PhotographsBecomeAScene) {
    photos(kNames);
    photo("IMG_4.JPG"), photo("c/d/9.png");
    write("photos/notes.txt", "no photograph");
    write("photos/b/raw.CR2", "no photograph that we read");
    store(0, made_model(kNames, 0.75));
    write("features_IMG_4.JPG", "120");
    const Result r = run("photos scene");
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_TRUE(r.says("5 of 7 photographs have poses")) << r;
    EXPECT_TRUE(r.says("Reprojection error 0.75 px on average")) << r;
    EXPECT_TRUE(r.says("IMG_4.JPG: no pose; 120 features, others have 1000")) << r;
    EXPECT_TRUE(r.says("between IMG_3.JPG and b/1.png")) << r;
    EXPECT_TRUE(r.says("Skipped 1 files, such as photos/b/raw.CR2")) << r;
    EXPECT_TRUE(r.says("Next, train on it:\n    tvsgs-train --scene scene")) << r;
    EXPECT_FALSE(fs::exists(folder / "scene/images/IMG_4.JPG"));
    EXPECT_FALSE(fs::exists(folder / "scene/images/c")) << "no pose in this folder";
    EXPECT_FALSE(fs::exists(folder / "scene.log"));
    EXPECT_NE(text("scene/prepare.log").find("I am mapper"), std::string::npos);
    EXPECT_EQ(report()["registered"].number, 5);
    EXPECT_NEAR(report()["residual_px"].number, 0.75, 1e-3);
    EXPECT_EQ(report()["missing"].items.at(0).text, "IMG_4.JPG");
    // Cameras span 40 degrees around the axis; the angles of all points are close to that.
    EXPECT_NEAR(report()["angle_deg"].number, 37, 3);
    // Photographs stay unchanged, and training reads them.
    EXPECT_EQ(text("scene/images/b/1.png"), text("photos/b/1.png"));
    SceneOptions options;
    options.path = (folder / "scene").string();
    const Scene scene = read_scene(options);
    ASSERT_EQ(scene.train.size(), 5u);
    EXPECT_EQ(scene.train[0].name, "IMG_1.JPG");
    EXPECT_EQ(scene.points.positions.size(), 20u);
    // COLMAP runs without a GPU and a display; photographs of one size share a camera.
    const std::string calls = text("calls.txt");
    EXPECT_NE(calls.find("offscreen: feature_extractor"), std::string::npos) << calls;
    EXPECT_NE(calls.find("--SiftExtraction.use_gpu 0"), std::string::npos) << calls;
    EXPECT_NE(calls.find("--SiftMatching.use_gpu 0"), std::string::npos) << calls;
    EXPECT_NE(calls.find("--ImageReader.single_camera 1"), std::string::npos) << calls;
    EXPECT_NE(calls.find("--ImageReader.camera_model SIMPLE_RADIAL"), std::string::npos) << calls;
    EXPECT_NE(calls.find("exhaustive_matcher"), std::string::npos) << calls;
    EXPECT_NE(calls.find("--ExhaustiveMatching.block_size "), std::string::npos) << calls;
    EXPECT_EQ(calls.find("bundle_adjuster"), std::string::npos) << calls;
}

TEST_F(Prepare, PhotographsOfASceneStayWhereTheyLie) {
    photos(kNames);
    photo("z.png");
    store(0, made_model(kNames));
    fs::create_directories(folder / "scene");
    fs::rename(folder / "photos", folder / "scene/images");
    Result r = run("scene/images scene/");
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_TRUE(fs::exists(folder / "scene/images/z.png"));
    EXPECT_EQ(read_sparse_model((folder / "scene/sparse/0").string()).images.size(), 5u);
    EXPECT_EQ(report()["registered"].number, 5);
    r = run("scene/images scene --anew");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says("scene/sparse already exists")) << r;
    // Adds nothing if it fails.
    for (const char* ours : {"scene/sparse", "scene/prepare.json", "scene/prepare.log"})
        fs::remove_all(folder / ours);
    write("fail_exhaustive_matcher", "");
    EXPECT_EQ(run("scene/images scene").code, 3);
    EXPECT_EQ(std::distance(fs::directory_iterator(folder / "scene"), {}), 1);
    write("scene/images/t.webp", "no picture");
    EXPECT_NE(run("scene/images scene").code, 0);
}

/// The last step must not fail after hours of COLMAP.
TEST_F(Prepare, TheSceneIsMadeInTheFolderThatIsThere) {
    photos(kNames);
    photo(".thumbnails/IMG_1.JPG");
    photo("b/.trash/old.png");
    store(0, made_model(kNames));
    // A link to an empty folder stays a link; the folder stays, as a mount point must.
    fs::create_directories(folder / "disk/empty");
    fs::create_directory_symlink("disk/empty", folder / "scene");
    const int watched = open((folder / "disk/empty").c_str(), O_RDONLY | O_DIRECTORY);
    struct stat before {
    }, after{};
    fstat(watched, &before);
    Result r = run("photos scene");
    ASSERT_EQ(r.code, 0) << r;
    stat((folder / "disk/empty").c_str(), &after);
    close(watched);
    EXPECT_EQ(before.st_ino, after.st_ino);
    EXPECT_TRUE(fs::is_symlink(folder / "scene"));
    EXPECT_EQ(std::distance(fs::directory_iterator(folder / "disk/empty"), {}), 4);
    EXPECT_EQ(report()["photographs"].number, 5) << "folders with a dot are not looked into";
    // Something else takes the place meanwhile: in an existing folder, or under a free name.
    for (const bool there : {true, false}) {
        const std::string scene = there ? "there" : "free";
        if (there) fs::create_directories(folder / scene);
        write("also_mapper", "mkdir -p " + scene + "/images; echo mine >" + scene + "/images/x");
        r = run("photos " + scene);
        EXPECT_EQ(r.code, 6) << r;
        EXPECT_TRUE(r.says("cannot move the result there")) << r;
        const std::string before_it = "it is in ";
        const std::size_t at = r.err.find(before_it) + before_it.size(), end = r.err.find(": make");
        ASSERT_LT(at, end) << r;
        EXPECT_EQ(read_sparse_model(r.err.substr(at, end - at) + "/sparse/0").images.size(), 5u);
        EXPECT_EQ(text(scene + "/images/x"), "mine\n");
        EXPECT_EQ(std::distance(fs::directory_iterator(folder / scene / "images"), {}), 1);
    }
    fs::remove(folder / "also_mapper");
    fs::create_symlink("nowhere", folder / "dangling");
    EXPECT_EQ(run("photos dangling").code, 2);
}

TEST_F(Prepare, OptionsThatWouldDoNothingAreRefused) {
    photos(kNames);
    write("v.mp4", "no video");
    for (const std::string wrong :
         {"photos scene --calibration c.yml --cameras each", "photos scene --frames 9",
          "photos scene --calibration c.yml --lens OPENCV", "v.mp4 scene --cameras one",
          "photos scene --markers-on wall", "photos scene --marker-dictionary DICT_4X4_50"}) {
        const Result r = run(wrong);
        EXPECT_EQ(r.code, 2) << r;
        EXPECT_TRUE(r.says("exclude each other") || r.says("remove it") ||
                    r.says("need --marker-size"))
            << r;
    }
}

TEST_F(Prepare, CamerasAndLensesFollowThePhotographs) {
    std::vector<std::string> names;
    for (int i = 0; i < 24; ++i) names.push_back(str("f", 10 + i, ".png"));
    photos(names);
    SparseModel model = made_model(names);
    model.cameras[0].model = 2, model.cameras[0].params = {70, 32, 24, -0.1};
    store(0, model);
    ASSERT_EQ(run("photos scene --threads 3 --feature-size 1000 --matcher sequential").code, 0);
    std::string calls = text("calls.txt");
    // The search starts with one coefficient; the others follow.
    EXPECT_NE(calls.find("--ImageReader.camera_model SIMPLE_RADIAL "), std::string::npos) << calls;
    const SparseCamera camera = read_sparse_model((folder / "scene/sparse/0").string()).cameras[0];
    EXPECT_EQ(camera.model, 4);
    EXPECT_EQ(camera.params, (std::vector<double>{70, 70, 32, 24, -0.1, 0, 0, 0}));
    EXPECT_NE(calls.find("--SiftExtraction.num_threads 3"), std::string::npos) << calls;
    EXPECT_NE(calls.find("--Mapper.num_threads 3"), std::string::npos) << calls;
    EXPECT_NE(calls.find("--SiftExtraction.max_image_size 1000"), std::string::npos) << calls;
    EXPECT_NE(calls.find("sequential_matcher"), std::string::npos) << calls;
    // Enough photographs of one camera determine its principal point.
    EXPECT_NE(calls.find("--BundleAdjustment.refine_principal_point 1"), std::string::npos);

    write("calls.txt", "");
    ASSERT_EQ(run("photos each --cameras each --lens OPENCV_FISHEYE").code, 0);
    calls = text("calls.txt");
    std::size_t extractions = 0;
    for (std::size_t at = 0; (at = calls.find("feature_extractor", at)) != std::string::npos; ++at)
        ++extractions;
    EXPECT_EQ(extractions, 24u);
    EXPECT_NE(calls.find("camera_model SIMPLE_RADIAL_FISHEYE"), std::string::npos);

    write("photos/wide.png", png_bytes(ImageU8(80, 48, 3)));
    const Result r = run("photos one --cameras one");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says("the photographs have 2 sizes, such as 64x48 and 80x48")) << r;
}

TEST_F(Prepare, TheLargestPieceIsKept) {
    const std::vector<std::string> small = {"a.png", "b.png"}, large = {"c.png", "d.png", "e.png"};
    photos(small), photos(large);
    store(0, made_model(small)), store(1, made_model(large));
    const Result r = run("photos scene");
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_TRUE(r.says("2 separate groups, of 3, 2")) << r;
    EXPECT_TRUE(
        r.says("a.png and b.png: connected with each other, not with the rest: add photographs "
               "towards c.png"))
        << r;
    EXPECT_EQ(read_sparse_model((folder / "scene/sparse/0").string()).images.size(), 3u);
}

TEST_F(Prepare, TooFewPosesAreAnError) {
    photos({"a.png", "b.png", "c.png", "d.png", "e.png"});
    store(0, made_model({"a.png", "b.png"}));
    Result r = run("photos scene");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says("2 of 5 photographs have poses, expected 50 % or more")) << r;
    EXPECT_TRUE(r.says("c.png to e.png (3 photographs): no pose; too little overlap")) << r;
    EXPECT_TRUE(r.says("--min-share 40")) << r;
    expect_nothing_left();
    // The accepted cameras are not searched again.
    write("calls.txt", "");
    EXPECT_TRUE(r.says("--model " + (folder / "scene.cameras").string())) << r;
    r = run("photos scene --min-share 40 --model scene.cameras");
    EXPECT_EQ(r.code, 0) << r;
    EXPECT_EQ(text("calls.txt"), "");
    // No model at all.
    fs::remove_all(folder / "models");
    fs::create_directories(folder / "models");
    write("fail_mapper", "");
    fs::remove_all(folder / "scene");
    r = run("photos scene");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says("no camera positions for the 5 photographs")) << r;
    expect_nothing_left();
}

TEST_F(Prepare, WhatFailsIsSaidAndLeavesNothing) {
    photos(kNames);
    store(0, made_model(kNames));
    for (const std::string step : {"feature_extractor", "exhaustive_matcher"}) {
        write("fail_" + step, "");
        const Result r = run("photos scene");
        EXPECT_EQ(r.code, 3) << r;
        EXPECT_TRUE(r.says("colmap " + step + " failed (exit code 1); last lines of " +
                           (folder / "scene.log").string()))
            << r;
        EXPECT_TRUE(r.says("this is why")) << r;
        expect_nothing_left();
        fs::remove(folder / ("fail_" + step));
    }
    write("crash_mapper", "");
    const Result r = run("photos scene");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says("colmap mapper failed (exit code 139)")) << r;
    expect_nothing_left();
    fs::remove(folder / "crash_mapper");
    // A truncated model.
    const std::string images = text("models/0/images.bin");
    write("models/0/images.bin", images.substr(0, images.size() / 2));
    const Result cut = run("photos scene");
    EXPECT_EQ(cut.code, 3) << cut;
    EXPECT_TRUE(cut.says("the file is cut off or damaged")) << cut;
    expect_nothing_left();
    // A log of the user stays.
    write("scene.log", "mine");
    EXPECT_EQ(run("photos scene").code, 3);
    EXPECT_EQ(text("scene.log"), "mine");
}

TEST_F(Prepare, ASignalEndsColmapAsWell) {
    photos(kNames);
    store(0, made_model(kNames));
    write("hang_mapper", "");
    const Result r = run("photos scene", "timeout -s TERM 3");
    EXPECT_TRUE(r.says("stopped by signal 15")) << r;
    expect_nothing_left();
    const int pid = std::stoi(text("pid.txt"));
    EXPECT_NE(kill(pid, 0), 0) << "COLMAP still runs";
}

TEST_F(Prepare, WhatIsMissingOrThereAlready) {
    Result r = run("photos scene");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says("photos: no such folder or video")) << r;
    photo("a.png");
    r = run("photos scene");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says("photos: 1 photographs")) << r;
    photos(kNames);
    r = run_script(folder,
                   "PATH=/nowhere " TVSGS_BIN_DIR "/tvsgs-prepare photos scene >out.txt 2>err.txt");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says("apt-get install colmap")) << r;
    const std::string colmap = text("bin/colmap");
    write("bin/colmap", "#!/bin/sh\necho libceres.so: cannot open; exit 127\n");
    r = run("photos scene");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says("colmap: does not start, exit code 127:") &&
                r.says("\n  libceres.so: cannot open"))
        << r;
    write("bin/colmap", colmap);
    r = run("photos photos/scene");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says("photos/scene: lies inside photos")) << r;
    write("photos/b/broken.png", "\x89PNG");
    r = run("photos scene");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says("photos/b/broken.png: cannot read it as an image")) << r;
    fs::remove(folder / "photos/b/broken.png");
    // Known cameras.
    store(0, made_model(kNames));
    fs::create_directories(folder / "sparse");
    fs::copy(folder / "models/0", folder / "sparse/0");
    r = run("photos scene");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(
        r.says("these photographs have cameras already, in " + (folder / "sparse/0").string()))
        << r;
    EXPECT_EQ(run("photos scene --anew").code, 0);
    r = run("photos scene --anew");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says("already exists and is not empty")) << r;
    expect_error(ExitCode::input, "cut off", [&] {
        write("short/cameras.bin", "abc");
        read_sparse_model((folder / "short").string());
    });
}

TEST_F(Prepare, PosesThatAreKnownAreKept) {
    photos(kNames);
    std::vector<std::string> more = kNames;
    more.push_back("elsewhere.png");
    write_sparse_model((folder / "mine").string(), made_model(more));
    store(0, made_model(kNames));
    write("version", "4.1.0");
    const Result r = run("photos scene --poses mine");
    ASSERT_EQ(r.code, 0) << r;
    const std::string calls = text("calls.txt");
    EXPECT_NE(calls.find("point_triangulator"), std::string::npos) << calls;
    EXPECT_NE(calls.find("--clear_points 1"), std::string::npos) << calls;
    EXPECT_EQ(calls.find(": mapper"), std::string::npos) << calls;
    // COLMAP's input: the poses of the existing photographs, without points.
    // COLMAP's converter also writes rigs and frames of all its photographs.
    const SparseModel given = read_sparse_model((folder / "given").string());
    EXPECT_FALSE(fs::exists(folder / "given/rigs.bin"));
    ASSERT_EQ(given.images.size(), kNames.size());
    EXPECT_TRUE(given.points.empty());
    EXPECT_EQ(given.images[2].translation.x, made_model(more).images[2].translation.x);

    // Poses of other photographs are refused before the features.
    write_sparse_model((folder / "others").string(), made_model({"x.png", "y.png", "z.png"}));
    write("calls.txt", "");
    const Result other = run("photos s2 --poses others");
    EXPECT_EQ(other.code, 3) << other;
    EXPECT_TRUE(other.says("has poses of 0 of the photographs")) << other;
    EXPECT_EQ(text("calls.txt").find("feature_extractor"), std::string::npos);
    // Poses that no point agrees with.
    SparseModel no_points = made_model(kNames);
    no_points.points.clear();
    fs::remove_all(folder / "models/0"), fs::remove_all(folder / "given");
    store(0, no_points);
    const Result apart = run("photos s2 --poses mine");
    EXPECT_EQ(apart.code, 3) << apart;
    EXPECT_TRUE(apart.says("mine: no point of the photographs agrees with these poses")) << apart;
    // A photograph that was converted to PNG keeps its own name in the poses.
    ImageU8 picture(64, 48, 3, 90);
    write("photos/IMG_1.webp", webp_bytes(picture, 90));
    fs::remove(folder / "photos/IMG_1.JPG");
    std::vector<std::string> own = kNames, converted = kNames;
    own[0] = "IMG_1.webp", converted[0] = "IMG_1.png";
    write_sparse_model((folder / "own").string(), made_model(own));
    fs::remove_all(folder / "models/0"), fs::remove_all(folder / "given");
    store(0, made_model(converted));
    ASSERT_EQ(run("photos s3 --poses own").code, 0);
    const SparseModel renamed = read_sparse_model((folder / "given").string());
    ASSERT_EQ(renamed.images.size(), kNames.size());
    EXPECT_EQ(renamed.images[0].name, "IMG_1.png");
}

/// A list with five control points that the photographs of made_model() show exactly. A unit of the
/// model is two metres. `wrong`: added to every second place, subtracted from the others, metres.
std::string control_list(const SparseModel& model, Vec3d away, Vec3d wrong = {}) {
    const Intrinsics in = intrinsics_of(model.cameras[0]);
    std::string text = "WGS84 UTM 32N\n";
    for (int i = 0; i < 5; ++i) {
        const Vec3d at{std::cos(2.0 * i), std::sin(2.0 * i), 0.2 * i},
            place = 2 * at + away + (i % 2 == 0 ? wrong : -wrong);
        for (const SparseImage& image : model.images) {
            const Vec2<double> px = project(in, image.camera_from_world(), at);
            text += fmt::format("{:.6f} {:.6f} {:.6f} {:.6f} {:.6f} {} p{}\n", place.x, place.y,
                                place.z, px.x, px.y, image.name, i);
        }
    }
    return text;
}

TEST_F(Prepare, ControlPointsPutTheSceneInPlace) {
    photos(kNames);
    const SparseModel model = made_model(kNames);
    store(0, model);
    const Vec3d away{691200, 5337600, 512};
    write("gcp_list.txt", control_list(model, away));
    const Result r = run("photos scene --gcp gcp_list.txt --checkpoints p3");
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_TRUE(r.says("p3: east 0.000, north 0.000, up 0.000 m; 5 marks, 0.0 px (checkpoint)"))
        << r;
    EXPECT_TRUE(r.says("Control points: 4 fitted, residual 0.000 m (RMS)")) << r;
    EXPECT_FALSE(r.says("scale unknown")) << r;
    EXPECT_EQ(report()["georeference"]["points"].items.size(), 5u);
    const auto place = read_georeference((folder / "scene").string());
    ASSERT_TRUE(place);
    EXPECT_EQ(place->projection, "EPSG:32632");
    const SparseModel placed = read_sparse_model((folder / "scene/sparse/0").string());
    for (std::size_t i = 0; i < kNames.size(); ++i) {
        const Vec3d centre = inverse(model.images[i].camera_from_world()).t;
        EXPECT_LT(norm(inverse(placed.images[i].camera_from_world()).t - (2 * centre + away)), 1e-4)
            << i;
    }
    // Training computes near zero, at the origin that the file names.
    SceneOptions options;
    options.path = (folder / "scene").string();
    const Scene scene = read_scene(options);
    EXPECT_LT(norm(scene.origin - away), 20);
    EXPECT_EQ(norm(scene.origin - place->origin), 0);
}

TEST_F(Prepare, CamerasAreKeptIfThePlacesDoNotFit) {
    photos(kNames);
    const SparseModel model = made_model(kNames);
    store(0, model);
    const Vec3d away{691200, 5337600, 512};
    write("gcp_list.txt", control_list(model, away, {0, 0, 5}));
    Result r = run("photos scene --gcp gcp_list.txt");
    EXPECT_EQ(r.code, 3) << r;
    for (const std::string& part :
         {std::string("p1: east "),
          std::string("the places do not fit the photographs: they spread "),
          str("After a correction, with --gcp, --gps or --marker-size as before: tvsgs-prepare "
              "photos scene "
              "--model ",
              (folder / "scene.cameras").string())})
        EXPECT_TRUE(r.says(part)) << part << r;
    EXPECT_FALSE(fs::exists(folder / "scene"));

    // COLMAP is not needed again.
    write("gcp_list.txt", control_list(model, away)), write("calls.txt", "");
    r = run("photos scene --gcp gcp_list.txt --model scene.cameras");
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_TRUE(r.says("Control points: 5 fitted, residual 0.000 m (RMS)")) << r;
    EXPECT_EQ(text("calls.txt"), "");
    EXPECT_EQ(read_sparse_model((folder / "scene/sparse/0").string()).points.size(),
              model.points.size());

    // Errors along the ground leave the plane of the points known, the scale less.
    write("gcp_list.txt", control_list(model, away, {0.2, 0.2, 0}));
    r = run("photos rough --gcp gcp_list.txt --model scene.cameras");
    EXPECT_EQ(r.code, 0) << r;
    EXPECT_TRUE(r.says("gcp_list.txt: the residuals leave the scale unknown by about ")) << r;

    // A model of smaller copies, without points, with a lost camera.
    const auto refused = [&](const std::function<void(SparseModel&)>& change, const char* why) {
        SparseModel changed = model;
        change(changed);
        fs::remove_all(folder / "changed");
        write_sparse_model((folder / "changed").string(), changed);
        r = run("photos s2 --model changed");
        EXPECT_EQ(r.code, 3) << r;
        EXPECT_TRUE(r.says(why)) << r;
    };
    refused([](SparseModel& m) { m.cameras[0].width = 32, m.cameras[0].height = 24; },
            "the camera of IMG_1.JPG has 32x24 pixels, the photograph 64x48");
    refused([](SparseModel& m) { m.points.clear(); }, "has no points; --poses changed makes them");
    refused([](SparseModel& m) { m.images[1].camera_id = 9; }, "camera 9");
    // A photograph that becomes a PNG.
    write("photos/IMG_1.webp", webp_bytes(ImageU8(64, 48, 3, 90), 90));
    fs::remove(folder / "photos/IMG_1.JPG");
    SparseModel own = model;
    own.images[0].name = "IMG_1.webp";
    write_sparse_model((folder / "own").string(), own);
    EXPECT_EQ(run("photos s3 --model own").code, 0);
    r = run("photos s2 --model scene.cameras");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says("has the photograph IMG_1.JPG, which is not in the folder")) << r;
    r = run("photos s2 --model photos");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says("photos: no cameras.bin; expected a COLMAP model")) << r;
    r = run("photos s2 --model scene.cameras --matcher sequential");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says("--matcher: has no effect with --model")) << r;
}

TEST_F(Prepare, FramesThatCannotBeAreRefusedBeforeColmap) {
    photos(kNames);
    store(0, made_model(kNames));
    write("gcp_list.txt", "EPSG:32632\n1 2 3 4 5 IMG_9.JPG\n");
    for (const auto& [flags, code, why] :
         {std::tuple("--gcp none.txt", 3, "none.txt"),
          {"--gcp gcp_list.txt", 3, "gcp_list.txt:2: no photograph 'IMG_9.JPG'"},
          {"--gps", 3, "--gps: 0 of the 5 photographs in photos have a place"},
          {"--gps --gcp gcp_list.txt", 2, "exclude each other"},
          {"--gps --marker-size 1", 2, "exclude each other"},
          {"--checkpoints a", 2, "--checkpoints needs --gcp"}}) {
        const Result r = run(str("photos scene ", flags));
        EXPECT_EQ(r.code, code) << r;
        EXPECT_TRUE(r.says(why)) << r;
        expect_nothing_left();
    }
    EXPECT_EQ(text("calls.txt").find("feature_extractor"), std::string::npos);
}

}  // namespace
}  // namespace tvsgs::prepare
