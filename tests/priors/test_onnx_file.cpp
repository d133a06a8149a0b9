// Reading what ONNX files say of their networks, whole, cut off and damaged.
#include "apps/priors/onnx_file.h"
#include "io/io_test.h"
#include "priors/onnx_writer.h"

namespace tvsgs::priors {
namespace {

using namespace test;

std::string two_outputs() {
    return onnx_file(
        node("Conv", {"image", "weights"}, {"depth"}, ints_attribute("kernel_shape", {1, 1}),
             "first") +
        node("Relu", {"depth"}, {"positive"}) + node("Relu", {"positive"}, {"again"}) +
        constant("weights", {1, 3, 1, 1}, {1, 2, 3}) + value_info(11, "image", {-1, 3, 48, 64}) +
        value_info(11, "weights", {1, 3, 1, 1}) + value_info(12, "depth", {1, 1, 48, 64}) +
        value_info(12, "again", {1, 1, -1, -1}));
}

TEST(OnnxFile, SaysInputsOutputsAndOperators) {
    const OnnxFile file = parse_onnx(two_outputs(), "two.onnx");
    EXPECT_EQ(text_of(file.inputs), "image (?, 3, 48, 64)");  // weights are none
    EXPECT_EQ(text_of(file.outputs), "depth (1, 1, 48, 64), again (1, 1, ?, ?)");
    EXPECT_EQ(file.operators, (std::vector<std::string>{"Conv", "Relu"}));
}

// The graph comes last, so that no beginning of the file holds a network.
TEST(OnnxFile, CutOffAnywhereIsRefused) {
    const std::string whole = two_outputs();
    for (std::size_t size = 0; size < whole.size(); ++size)
        expect_error(ExitCode::input, "E_ONNX: cut.onnx: ", [&] {
            parse_onnx(std::string_view(whole).substr(0, size), "cut.onnx");
        });
}

TEST(OnnxFile, OtherFilesAreRefused) {
    for (const std::string text : {"\x89PNG\r\n\x1a\n", "PK\x03\x04 a weights file of PyTorch",
                                   "<!DOCTYPE html><html>Not found</html>", "{\"json\": 1}"})
        expect_error(ExitCode::input, "is no ONNX file, or is cut off",
                     [&] { parse_onnx(text, "other.onnx"); });
}

// Of damaged bytes either a network comes out, or an error of ours.
TEST(OnnxFile, DamagedBytesDoNoHarm) {
    const std::string whole = two_outputs();
    int read = 0, refused = 0;
    for (std::size_t at = 0; at < whole.size(); ++at)
        for (const int damage : {1, 128, 255}) {
            std::string bytes = whole;
            bytes[at] = static_cast<char>(bytes[at] ^ damage);
            try {
                parse_onnx(bytes, "damaged.onnx");
                ++read;
            } catch (const Error& error) {
                EXPECT_EQ(error.code(), ExitCode::input);
                ++refused;
            }
        }
    EXPECT_GT(read, 100);
    EXPECT_GT(refused, 100);
}

}  // namespace
}  // namespace tvsgs::priors
