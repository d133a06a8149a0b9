// Small networks whose results are known, through OpenCV's DNN module.
#include <limits>

#include "apps/priors/network.h"
#include "io/io_test.h"
#include "priors/onnx_writer.h"

namespace tvsgs::priors {
namespace {

using namespace test;

class NetworkTest : public IoTest {
protected:
    Network load(const std::string& bytes, const std::string& output = "") const {
        return Network(write("net.onnx", bytes), output);
    }
    void expect_refused(const std::string& bytes,
                        const std::string& text,
                        const std::string& output = "") const {
        expect_error(ExitCode::input, text, [&] { load(bytes, output); });
    }
    /// One node of no attributes from the image to the map.
    static std::string one_node(const std::string& op, const std::string& name = "") {
        return onnx_file(node(op, {"image"}, {"map"}, "", name) +
                         value_info(11, "image", {1, 3, 2, 2}) +
                         value_info(12, "map", {1, 3, 2, 2}));
    }
};

/// 0, 1, 2, ...
std::vector<float> counting(std::size_t count) {
    std::vector<float> numbers(count);
    for (std::size_t i = 0; i < count; ++i) numbers[i] = static_cast<float>(i);
    return numbers;
}

// 0.5 + R + 2 G + 3 B, where plane c of the image begins at 12 c.
TEST_F(NetworkTest, RunsALinearMap) {
    for (const Ints& shape : {Ints{1, 3, 3, 4}, Ints{-1, 3, -1, -1}}) {
        Network network = load(convolution(shape, 1, {1, 2, 3}, {0.5f}));
        EXPECT_EQ(network.output(), "map");
        const Tensor out = network.run(counting(36), 4, 3);
        EXPECT_EQ(out.shape, (Ints{1, 1, 3, 4}));
        ASSERT_EQ(out.numbers.size(), 12u);
        for (std::size_t i = 0; i < 12; ++i) {
            const float p = static_cast<float>(i);
            EXPECT_FLOAT_EQ(out.numbers[i], 0.5f + p + 2 * (p + 12) + 3 * (p + 24)) << i;
        }
    }
}

TEST_F(NetworkTest, GivesTheOutputThatIsAskedFor) {
    const std::string bytes = onnx_file(
        node("Relu", {"image"}, {"plain"}) + node("Sigmoid", {"plain"}, {"squashed"}, "", "last") +
        value_info(11, "image", {1, 3, 2, 2}) + value_info(12, "squashed", {1, 3, 2, 2}) +
        value_info(12, "plain", {1, 3, 2, 2}));
    // "plain" is used by the other one as well.
    EXPECT_FLOAT_EQ(load(bytes, "plain").run(counting(12), 2, 2).numbers[3], 3);
    EXPECT_NEAR(load(bytes, "squashed").run(counting(12), 2, 2).numbers[3], 0.952574f, 1e-5f);
    expect_refused(bytes, "has the outputs squashed (1, 3, 2, 2), plain (1, 3, 2, 2); name one");
    expect_refused(bytes, "expected one of them for --output, found 'other'", "other");
}

TEST_F(NetworkTest, AnOperatorThatTheModuleLacksIsNamed) {
    const std::string version = " is not in the DNN module of OpenCV " + Network::opencv_version();
    expect_refused(one_node("Frobnicate"), "operator Frobnicate" + version);
    expect_refused(one_node("DeformAttention", "head/attention"),
                   "operator DeformAttention" + version);
    // Known, and used as the module does not know it: kernel and weights are missing.
    expect_refused(one_node("Conv", "stem"), "operator Conv (");
    // It takes two inputs, and the module reads the second one unchecked.
    expect_refused(one_node("Pow"), "E_ONNX: ");  // how it ends depends on the version
}

TEST_F(NetworkTest, OtherInputsThanAnImageAreRefused) {
    const auto with_input = [](const std::string& inputs) {
        return onnx_file(node("Relu", {"image"}, {"map"}) + inputs +
                         value_info(12, "map", {1, 3, 2, 2}));
    };
    expect_refused(
        with_input(value_info(11, "image", {1, 3, 2, 2}) + value_info(11, "intrinsics", {1, 3, 3})),
        "takes 2 inputs, image (1, 3, 2, 2), intrinsics (1, 3, 3); expected one");
    expect_refused(with_input(value_info(11, "image", {1, 2, 2, 3})),
                   "export it with channels before height and width");
    expect_refused(with_input(value_info(11, "image", {1, 1, 2, 2})),
                   "takes image (1, 1, 2, 2); expected an image (1, 3, height, width)");
    expect_refused(with_input(value_info(11, "image", {4, 3, 2, 2})), "takes image (4, 3, 2, 2)");
    expect_refused(with_input(value_info(11, "image", {1, 12})), "takes image (1, 12)");
    expect_refused(with_input(""), "takes 0 inputs, none");
    expect_error(ExitCode::input, "absent.onnx", [&] { Network(folder / "absent.onnx", ""); });
}

TEST_F(NetworkTest, WeightsInAnotherFileAreNamed) {
    expect_refused(
        onnx_file(node("Conv", {"image", "weights"}, {"map"}) +
                  constant_elsewhere("weights", {1, 3, 1, 1}) +
                  value_info(11, "image", {1, 3, 2, 2}) + value_info(12, "map", {1, 1, 2, 2})),
        "keeps weights in another file, net.onnx.data");
}

TEST_F(NetworkTest, SizesAreTheFilesOrTheUsers) {
    const Network fixed = load(convolution({1, 3, 3, 4}, 1, {1, 2, 3}, {0})),
                  open = load(convolution({1, 3, -1, -1}, 1, {1, 2, 3}, {0})),
                  wide = load(convolution({1, 3, 3, -1}, 1, {1, 2, 3}, {0}));
    const InputSize none, own{InputSize::By::both, 4, 3, 0, 1},
        other{InputSize::By::both, 8, 6, 0, 1}, side{InputSize::By::long_side, 0, 0, 8, 2};
    EXPECT_EQ(text_of(fixed.settled(none, false), Fit::stretch), "4x3");
    EXPECT_EQ(text_of(fixed.settled(own, false), Fit::stretch), "4x3");
    EXPECT_EQ(text_of(fixed.settled(other, true), Fit::stretch), "4x3");
    EXPECT_EQ(text_of(open.settled(other, true), Fit::stretch), "8x6");
    EXPECT_EQ(text_of(open.settled(side, false), Fit::stretch), "8 long, multiples of 2");
    expect_error(ExitCode::usage, "takes images of 4x3 pixels, the size asked for makes 8x6",
                 [&] { fixed.settled(other, false); });
    expect_error(ExitCode::usage, "takes images of ?x3 pixels",
                 [&] { wide.settled(other, false); });
    for (const Network* network : {&open, &wide})
        expect_error(ExitCode::usage, "leaves the size of its input open; give it by --size",
                     [&] { network->settled(none, false); });
    Network runs = load(convolution({1, 3, 3, 4}, 1, {1, 2, 3}, {0}));
    expect_error(ExitCode::usage, "the size asked for makes 3x4",
                 [&] { runs.run(counting(36), 3, 4); });
}

TEST_F(NetworkTest, NumbersThatAreNotFiniteAreRefused) {
    const float huge = std::numeric_limits<float>::max();
    Network network = load(convolution({1, 3, 2, 2}, 1, {huge, huge, huge}, {0}));
    expect_error(ExitCode::numerical, "gives NaN or infinity in 4 of 4 numbers of 'map'",
                 [&] { network.run(counting(12), 2, 2); });
    Network logarithm = load(one_node("Log"));
    std::vector<float> image(12, 1.f);
    EXPECT_EQ(logarithm.run(image, 2, 2).numbers[5], 0);
    image[5] = -1;
    expect_error(ExitCode::numerical, "in 1 of 12 numbers", [&] { logarithm.run(image, 2, 2); });
}

// A network of another size than it was exported for, as its file does not say.
TEST_F(NetworkTest, WhatDoesNotRunSaysTheModulesReason) {
    Network network = load(
        onnx_file(node("Reshape", {"image", "shape"}, {"map"}) + constant("shape", Ints{1, 3, 4}) +
                  value_info(11, "image", {1, 3, -1, -1}) + value_info(12, "map", {1, 3, 4})));
    expect_error(ExitCode::input, "does not run on an image of 3x3 in OpenCV",
                 [&] { network.run(counting(27), 3, 3); });
}

}  // namespace
}  // namespace tvsgs::priors
