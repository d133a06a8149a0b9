// tvsgs-prepare with each generation of COLMAP.
#include <array>

#include "apps/prepare/colmap.h"
#include "prepare/prepare_test.h"

namespace tvsgs::prepare {
namespace {

/// Version, words of the extraction, words of the matching.
const std::vector<std::array<std::string, 3>> kGenerations = {
    {"3.8",
     "--SiftExtraction.use_gpu 0 --SiftExtraction.max_image_size 2000 "
     "--SiftExtraction.num_threads 3",
     "--SiftMatching.use_gpu 0 --SiftMatching.num_threads 3"},
    {"3.13.0",
     "--FeatureExtraction.use_gpu 0 --SiftExtraction.max_image_size 2000 "
     "--FeatureExtraction.num_threads 3",
     "--FeatureMatching.use_gpu 0 --FeatureMatching.num_threads 3"},
    {"4.1.0",
     "--FeatureExtraction.use_gpu 0 --FeatureExtraction.max_image_size 2000 "
     "--FeatureExtraction.num_threads 3",
     "--FeatureMatching.use_gpu 0 --FeatureMatching.num_threads 3"}};

TEST_F(Prepare, EveryGenerationOfColmapGetsItsOptions) {
    photos(kNames);
    photo("IMG_4.JPG");
    store(0, made_model(kNames));
    write("features_IMG_4.JPG", "120");
    for (const auto& [version, extraction, matching] : kGenerations) {
        for (const char* old : {"scene", "calls.txt", "asked.txt"}) fs::remove_all(folder / old);
        write("version", version);
        const Result r = run("photos scene --threads 3");
        ASSERT_EQ(r.code, 0) << r;
        const std::string calls = text("calls.txt");
        EXPECT_NE(calls.find(extraction), std::string::npos) << calls;
        EXPECT_NE(calls.find(matching), std::string::npos) << calls;
        EXPECT_TRUE(r.says("COLMAP " + version + ", on the CPU\n")) << r;
        EXPECT_TRUE(r.says("IMG_4.JPG: no pose; 120 features, others have 1000")) << r;
        EXPECT_NE(text("scene/prepare.log").find("COLMAP " + version + ", "), std::string::npos);
        EXPECT_EQ(report()["colmap"].text, version);
        EXPECT_EQ(report()["feature_size"].number, 2000);
        EXPECT_EQ(text("asked.txt"),
                  "help\nexhaustive_matcher\nmapper\nbundle_adjuster\nfeature_extractor\n");
    }
}

TEST_F(Prepare, ColmapKeepsToTheThreads) {
    photos(kNames);
    store(0, made_model(kNames));
    write("also_mapper", "echo \"$OMP_NUM_THREADS\" >threads.txt\n");
    ASSERT_EQ(run("photos given --threads 3", "OMP_NUM_THREADS=2").code, 0);
    EXPECT_EQ(text("threads.txt"), "3\n");
    ASSERT_EQ(run("photos other", "OMP_NUM_THREADS=2").code, 0);
    EXPECT_EQ(text("threads.txt"), "2\n");
}

TEST_F(Prepare, OptionsThatColmapLacksEndBeforeTheFirstStep) {
    photos(kNames);
    store(0, made_model(kNames));
    write("version", "9.0.0");
    Result r = run("photos scene");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says((folder / "bin/colmap").string() +
                       ": COLMAP 9.0.0 does not list the option --FeatureMatching.use_gpu or "
                       "--SiftMatching.use_gpu in 'colmap exhaustive_matcher -h'"))
        << r;
    expect_nothing_left();
    // Without a twin in an older group; the mapper is asked before the features are searched.
    write("version", "3.8");
    write("hidden", "Mapper.min_model_size\n");
    r = run("photos scene");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says("--Mapper.min_model_size in 'colmap mapper -h'")) << r;
    EXPECT_EQ(text("calls.txt"), "");
    expect_nothing_left();
}

TEST_F(Prepare, AMapperWithoutAModelIsAnErrorWithAdvice) {
    photos(kNames);
    fs::create_directories(folder / "models");
    for (const auto& generation : kGenerations) {
        write("version", generation[0]);
        const Result r = run("photos scene");
        EXPECT_EQ(r.code, 3) << r;
        EXPECT_TRUE(
            r.says("COLMAP " + generation[0] +
                   " found no camera positions for the 5 photographs (1,000 features each)"))
            << r;
        EXPECT_TRUE(r.says("each sharing two thirds with the next")) << r;
        EXPECT_FALSE(r.says("or try")) << r;
        expect_nothing_left();
    }
    write("photos/large.png", png_bytes(ImageU8(300, 20, 3)));
    const Result r = run("photos scene --matcher sequential --feature-size 200");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says(", or try --matcher exhaustive and --feature-size 300")) << r;
}

TEST_F(Prepare, LargePhotographsAreReducedForTheFeatures) {
    photos(kNames);
    write("photos/large.png", png_bytes(ImageU8(20, 2400, 3)));
    store(0, made_model(kNames));
    const std::string line = "Features are searched at 2,000 of 2,400 pixels (longest side)";
    Result r = run("photos reduced");
    EXPECT_TRUE(r.says(line)) << r;
    EXPECT_NE(text("calls.txt").find("max_image_size 2000"), std::string::npos);
    r = run("photos full --feature-size 2400");
    EXPECT_FALSE(r.says("Features are searched at")) << r;
    EXPECT_NE(text("calls.txt").find("max_image_size 2400"), std::string::npos);
}

TEST_F(Prepare, ManyPhotographsAreMatchedThroughTheirNeighbours) {
    std::vector<std::string> names;
    const std::string picture = png_bytes(ImageU8(64, 48, 3, 90));
    for (int i = 0; i < 201; ++i) {
        names.push_back(str("f", 100 + i, ".png"));
        write("photos/" + names.back(), picture);
    }
    const std::vector<std::string> found(names.begin(), names.begin() + 5);
    store(0, made_model(found));
    const Result r = run("photos scene --min-share 0");
    ASSERT_EQ(r.code, 0) << r;
    const std::string calls = text("calls.txt");
    const std::size_t first = calls.find(": sequential_matcher"),
                      second = calls.find(": transitive_matcher"), last = calls.find(": mapper");
    EXPECT_LT(first, second) << calls;
    EXPECT_LT(second, last) << calls;
    EXPECT_EQ(calls.find("exhaustive_matcher"), std::string::npos) << calls;
    // One less: all pairs.
    fs::remove(folder / "photos" / names.back());
    write("calls.txt", "");
    ASSERT_EQ(run("photos all --min-share 0").code, 0);
    EXPECT_NE(text("calls.txt").find(": exhaustive_matcher"), std::string::npos);
}

TEST_F(Prepare, TheProgressMovesOnATerminal) {
    photos(kNames);
    store(0, made_model(kNames));
    write("also_exhaustive_matcher", "say 'Matching block [1/2, 2/2] in 0.5s'\nsleep 1.5\n");
    const Result r =
        run_script(folder, "PATH=$PWD/bin:/usr/bin:/bin script -qec '" TVSGS_BIN_DIR
                           "/tvsgs-prepare photos scene' /dev/null >err.txt 2>&1 </dev/null");
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_TRUE(r.says("exhaustive matching 0:") && r.says("[##########..........] 50 %")) << r;
}

TEST(ColmapLog, SharesOfEveryGeneration) {
    const std::string glog = "I20251107 12:00:00.123456 77 pairing.cc:12] ";
    EXPECT_EQ(message_of(glog + "  Features:        8509 (SIFT)"), "Features:        8509 (SIFT)");
    EXPECT_EQ(message_of("W0428 14:23:30.434450 5 a.cc:3] [1/2] "), "[1/2]");
    EXPECT_EQ(message_of("  Name:            In [1] a.png"), "Name:            In [1] a.png");
    EXPECT_EQ(message_of("Image [1] a.png"), "Image [1] a.png");
    EXPECT_EQ(number_after("Features:        8509 (SIFT)", "Features:"), 8509u);
    EXPECT_EQ(number_after("Features: none", "Features:"), std::nullopt);
    // After a part, before it.
    EXPECT_DOUBLE_EQ(share_of_matches("Matching block [2/3, 1/3] in 0.512s"), 4. / 9);
    EXPECT_DOUBLE_EQ(share_of_matches("Matching block [2/3, 1/3]"), 3. / 9);
    EXPECT_DOUBLE_EQ(share_of_matches("Processing block [3/3, 3/3]"), 8. / 9);
    EXPECT_DOUBLE_EQ(share_of_matches("Matching image [5/24] in 0.012s"), 5. / 24);
    EXPECT_DOUBLE_EQ(share_of_matches("Processing image [5/24]"), 4. / 24);
    for (const char* other : {"in 0.353s", "", "Matching block [0/0, 0/0]", "Indexing image [2/3]",
                              "Matching block", "Exhaustive feature matching"})
        EXPECT_EQ(share_of_matches(other), 0) << other;
    EXPECT_DOUBLE_EQ(share_of_poses("Registering image #6 (3)", 12), 0.25);
    EXPECT_DOUBLE_EQ(share_of_poses("Registering image #6 (num_reg_frames=3)", 12), 0.25);
    EXPECT_DOUBLE_EQ(share_of_poses("Triangulating image #6 (3)", 12), 0.25);
    EXPECT_EQ(share_of_poses("=> Image sees 3 / 12 points (3)", 12), 0);
}

}  // namespace
}  // namespace tvsgs::prepare
