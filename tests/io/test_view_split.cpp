#include "io/io_test.h"
#include "io/scene/scene_reader.h"

namespace tvsgs {
namespace {

class ViewSplitTest : public IoTest {
protected:
    SceneOptions options;
    std::vector<std::string> names;
    std::vector<bool> exists;

    void SetUp() override {
        IoTest::SetUp();
        options.path = folder.string();
        for (int i = 0; i < 20; ++i)
            names.push_back(str("cam", i % 2, "/", i / 10, i % 10, ".jpg"));
        std::sort(names.begin(), names.end());  // cam0: even numbers, cam1: odd ones
        exists.assign(20, true);
    }
    ViewSplit split() const { return split_views(options, names, exists); }
};

using Indices = std::vector<int>;

TEST_F(ViewSplitTest, AllTrainByDefault) {
    EXPECT_EQ(split().train.size(), 20u);
    EXPECT_TRUE(split().test.empty());
}

TEST_F(ViewSplitTest, EveryEighthTests) {
    options.eval = true;
    EXPECT_EQ(split().test, (Indices{0, 8, 16}));
    EXPECT_EQ(split().train.size(), 17u);
    options.test_every = 10;
    EXPECT_EQ(split().test, (Indices{0, 10}));
    options.test_every = 1;
    expect_error(ExitCode::usage, "--test-every", [&] { split(); });
}

TEST_F(ViewSplitTest, NamedLists) {
    write(
        "splits.json",
        R"({"train_3": ["cam0/00.jpg", "cam1/03", "04.jpg", "05", "cam0/00.jpg"], "test": ["06", "05"],
                            "far_train_2": [0, 1], "far_test": ["19"], "other": [2, 3]})");
    options.split = "train_3";
    EXPECT_EQ(split().train,
              (Indices{0, 2, 11, 12}));  // full name, stem, base name, base stem; once each, sorted
    EXPECT_EQ(split().test, (Indices{3}));  // 05 trains, so it is not tested
    options.split = "far_train_2";
    EXPECT_EQ(split().train, (Indices{0, 1}));
    EXPECT_EQ(split().test, (Indices{19}));
    options.split = "other";
    EXPECT_EQ(split().train, (Indices{2, 3}));
    EXPECT_EQ(split().test, (Indices{12}));  // 06 trains here
    options.split = "none";
    expect_error(ExitCode::input, "has far_test, far_train_2, other, test, train_3",
                 [&] { split(); });
    options.split = "test";
    expect_error(ExitCode::usage, "test views", [&] { split(); });
}

TEST_F(ViewSplitTest, SplitFileOfPgsr) {
    options.split = "train";
    expect_error(ExitCode::input, "splits.json", [&] { split(); });
    write("split.json", R"({"train": ["00", "02"], "test": ["04"]})");
    EXPECT_EQ(split().train, (Indices{0, 1}));
    EXPECT_EQ(split().test, (Indices{2}));
}

TEST_F(ViewSplitTest, ListFiles) {
    options.train_list = write("train.txt", "# comment\n cam0/00.jpg \r\n\n1\n");
    EXPECT_EQ(split().train, (Indices{0, 1}));
    EXPECT_TRUE(split().test.empty());
    options.test_list = write("test.txt", "19");
    EXPECT_EQ(split().test, (Indices{19}));
    options.train_list.clear();
    EXPECT_EQ(split().train.size(), 19u);  // the rest
    options.test_list = write("test.txt", "20");
    expect_error(ExitCode::input, "'20' fits none of the 20 images", [&] { split(); });
    options.test_list = write("test.txt", "\n");
    expect_error(ExitCode::input, "test.txt", [&] { split(); });
}

TEST_F(ViewSplitTest, AmbiguousNames) {
    names = {"a/1.jpg", "a/2.jpg", "b/1.jpg", "b/1.png"};
    exists.assign(4, true);
    options.test_list = write("test.txt", "1.jpg");
    expect_error(ExitCode::input, "several images", [&] { split(); });
    options.test_list = write("test.txt", "b/1");
    expect_error(ExitCode::input, "several images", [&] { split(); });
    options.test_list = write("test.txt", "1.png\na/1");
    EXPECT_EQ(split().test, (Indices{0, 3}));
}

TEST_F(ViewSplitTest, ChosenViews) {
    options.views = "12, 3,3,4";
    EXPECT_EQ(split().train, (Indices{3, 4, 12}));
    for (const char* wrong : {"20", "-1", "a", "1,,2", "1 2"}) {
        options.views = wrong;
        expect_error(ExitCode::usage, "--views", [&] { split(); });
    }
    options.eval = true;
    options.views = "1,2,3";
    EXPECT_EQ(split().train, (Indices{1, 2, 3}));
    EXPECT_EQ(split().test, (Indices{0, 8, 16}));
    options.views = "1,8";
    expect_error(ExitCode::usage, "not a training view", [&] { split(); });
}

TEST_F(ViewSplitTest, EvenlyChosenViews) {
    options.num_views = 3;
    EXPECT_EQ(split().train, (Indices{0, 10, 19}));  // round(19 / 2) = 10
    options.num_views = 100;
    EXPECT_EQ(split().train.size(), 20u);
    options.num_views = 1;
    expect_error(ExitCode::input, "E_TOO_FEW_VIEWS", [&] { split(); });
    options.min_train_views = 1;
    EXPECT_EQ(split().train, (Indices{0}));
    options.views = "1";
    expect_error(ExitCode::usage, "exclude each other", [&] { split(); });
}

TEST_F(ViewSplitTest, MissingImages) {
    exists[0] = exists[5] = false;
    EXPECT_EQ(split().train.size(), 18u);
    options.eval = true;
    EXPECT_EQ(split().test,
              (Indices{8, 16}));  // the rule counts the model's images, so that nothing shifts
    options.eval = false;
    options.views = "4,5";
    expect_error(ExitCode::input, "E_MISSING_IMAGE: training view '" + names[5], [&] { split(); });
}

TEST_F(ViewSplitTest, OneRuleOnly) {
    options.eval = true;
    options.split = "train_3";
    expect_error(ExitCode::usage, "exclude each other", [&] { split(); });
}

}  // namespace
}  // namespace tvsgs
