// The command tvsgs-eval geometry: its output and exit codes.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

namespace {

namespace fs = std::filesystem;

class EvalGeometry : public testing::Test {
protected:
    void SetUp() override {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_eval_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
        write("truth.ply", "0 0 0\n1 0 0\n2 0 0\n3 0 0\n");
        write("half.ply", "0 0 0.25\n1 0 0.25\n");
    }
    void TearDown() override { fs::remove_all(folder_); }

    std::string path(const std::string& name) const { return (folder_ / name).string(); }
    void write(const std::string& name,
               const std::string& vertices,
               const std::string& faces = "") const {
        const auto lines = [](const std::string& text) {
            return std::to_string(std::count(text.begin(), text.end(), '\n'));
        };
        std::ofstream(path(name))
            << "ply\nformat ascii 1.0\nelement vertex " << lines(vertices)
            << "\nproperty float x\nproperty float y\nproperty float z\nelement face "
            << lines(faces) << "\nproperty list uchar int vertex_indices\nend_header\n"
            << vertices << faces;
    }
    /// Returns the exit code; standard output goes to `output_`, messages to `messages_`.
    int eval(const std::string& arguments) {
        const std::string command = std::string(TVSGS_BIN_DIR) + "/tvsgs-eval geometry " +
                                    arguments + " >" + path("out") + " 2>" + path("err");
        const int status = std::system(command.c_str());
        output_ = read("out"), messages_ = read("err");
        return WEXITSTATUS(status);
    }
    std::string read(const std::string& name) const {
        std::ifstream file(path(name));
        return {std::istreambuf_iterator<char>(file), {}};
    }
    std::string inputs() const {
        return "--pred " + path("half.ply") + " --gt " + path("truth.ply");
    }

    fs::path folder_;
    std::string output_, messages_;
};

TEST_F(EvalGeometry, PrintsAndWritesJson) {
    ASSERT_EQ(eval(inputs() + " --tau 0.3,2 --out " + path("result.json")), 0) << messages_;
    EXPECT_NE(output_.find("\"accuracy\": 0.25"), std::string::npos) << output_;
    EXPECT_NE(output_.find("\"precision\": 1, \"recall\": 0.5"), std::string::npos) << output_;
    EXPECT_NE(output_.find("\"points\": {\"pred\": 2, \"gt\": 4, \"dropped_not_finite\": 0, "
                           "\"gt_dropped_not_finite\": 0}"),
              std::string::npos)
        << output_;
    EXPECT_EQ(messages_.find("finite"), std::string::npos) << messages_;
    EXPECT_EQ(read("result.json"), output_);
}

TEST_F(EvalGeometry, MeshesAreMeasuredAsSurfaces) {
    // A square of side 1 below one of side 10: all of it is found, and 1.56 % of the large one is
    // near.
    write("small.ply", "0 0 0\n1 0 0\n1 1 0\n0 1 0\n", "3 0 1 2\n3 0 2 3\n");
    write("large.ply", "-4 -4 0.1\n6 -4 0.1\n6 6 0.1\n-4 6 0.1\n", "3 0 1 2\n3 0 2 3\n");
    const std::string meshes = "--pred " + path("large.ply") + " --gt " + path("small.ply");
    ASSERT_EQ(eval(meshes + " --tau 0.12,0.1 --require 'recall@0.12>=1' --require 'recall@0.1<=0'"),
              0)
        << messages_;
    EXPECT_NE(output_.find("\"median_completeness\": 0.1"), std::string::npos) << output_;
    EXPECT_NE(output_.find("\"precision_se\": 0.000"), std::string::npos) << output_;
    EXPECT_NE(messages_.find("of the mesh of 2 triangles"), std::string::npos) << messages_;
    // With a fixed number of points on each mesh only few are close to each other.
    ASSERT_EQ(eval(meshes + " --tau 0.12 --point-samples 500 --require 'recall@0.12<0.5'"), 0);
    EXPECT_EQ(output_.find("_se"), std::string::npos) << output_;
    EXPECT_EQ(eval(meshes + " --samples 500"), 2);
}

TEST_F(EvalGeometry, WhatIsNotFiniteIsSaidAndCounted) {
    write("holes.ply", "0 0 0.25\nnan 0 0\n1 0 0.25\n0 inf 0\n");
    write("torn.ply", "0 0 0\n1 0 0\n1 1 0\n0 1 nan\n", "3 0 1 2\n3 0 2 3\n");
    write("seen.ply", "0 0 0\n0 0 -inf\n");
    ASSERT_EQ(eval("--pred " + path("holes.ply") + " --gt " + path("torn.ply") + " --visible-gt " +
                   path("seen.ply")),
              0)
        << messages_;
    EXPECT_NE(output_.find("\"visible_gt\": 1, \"dropped_not_finite\": 2, "
                           "\"gt_dropped_not_finite\": 1, \"visible_gt_dropped_not_finite\": 1}"),
              std::string::npos)
        << output_;
    for (const char* said :
         {"holes.ply: dropped 2 points that are not finite\n",
          "torn.ply: dropped 1 vertices that are not finite, and their faces\n",
          "seen.ply: dropped 1 points that are not finite\n", "of the mesh of 1 triangles"})
        EXPECT_NE(messages_.find(said), std::string::npos) << said << " in\n" << messages_;
    // As a prediction, and with a fixed number of points on each mesh.
    ASSERT_EQ(eval("--pred " + path("torn.ply") + " --gt " + path("holes.ply") +
                   " --point-samples 100 --quiet"),
              0)
        << messages_;
    EXPECT_NE(output_.find("\"dropped_not_finite\": 1, \"gt_dropped_not_finite\": 2}"),
              std::string::npos)
        << output_;
    EXPECT_NE(messages_.find("torn.ply: dropped 1 vertices"), std::string::npos) << "a warning";
}

TEST_F(EvalGeometry, BoundsDecideTheExitCode) {
    EXPECT_EQ(eval(inputs() + " --tau 0.30 --require 'accuracy<=0.25' --require 'recall@0.3>=0.5' "
                              "--require 'f1@.3 > 0.6'"),
              0)
        << messages_;
    EXPECT_EQ(eval(inputs() + " --require 'accuracy<0.25'"), 8);
    EXPECT_NE(messages_.find("accuracy is 0.25"), std::string::npos) << messages_;
    EXPECT_NE(output_.find("accuracy"), std::string::npos);  // the numbers are still printed
    EXPECT_EQ(eval(inputs() + " --require 'f1@1>=0'"), 2);   // no such threshold
    EXPECT_EQ(eval(inputs() + " --require 'accuracy'"), 2);
    EXPECT_EQ(eval(inputs() + " --tau 0.3,x"), 2);
    EXPECT_EQ(eval(inputs() + " --max_distnce 3"), 2);
    EXPECT_NE(messages_.find("--max-distance"), std::string::npos) << messages_;
    EXPECT_EQ(eval(inputs() + " --max_distance 3"), 0);  // underscores are fine
}

TEST_F(EvalGeometry, BadInput) {
    EXPECT_EQ(eval("--pred " + path("nope.ply") + " --gt " + path("truth.ply")), 3);
    write("empty.ply", "");
    EXPECT_EQ(eval("--pred " + path("empty.ply") + " --gt " + path("truth.ply")), 3) << messages_;
    write("nan.ply", "nan 0 0\n0 nan 0\n1 0 0\n", "3 0 1 2\n");
    EXPECT_EQ(eval("--pred " + path("nan.ply") + " --gt " + path("truth.ply")), 3) << messages_;
    write("flat.ply", "0 0 0\n1 0 0\n2 0 0\n", "3 0 1 2\n3 1 1 1\n");
    EXPECT_EQ(eval("--pred " + path("flat.ply") + " --gt " + path("truth.ply")), 3) << messages_;
    EXPECT_NE(messages_.find("no area"), std::string::npos) << messages_;
    write("wrong.ply", "0 0 0\n1 0 0\n0 1 0\n", "3 0 1 9\n");
    EXPECT_EQ(eval("--pred " + path("wrong.ply") + " --gt " + path("truth.ply")), 3) << messages_;
    EXPECT_NE(messages_.find("wrong.ply"), std::string::npos) << messages_;
    std::ofstream(path("crop.json")) << R"({"box": [[10, 10, 10], [11, 11, 11]]})";
    EXPECT_EQ(eval(inputs() + " --crop " + path("crop.json")), 3);
    EXPECT_NE(messages_.find("they span"), std::string::npos) << messages_;
}

}  // namespace
