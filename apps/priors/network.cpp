#include "apps/priors/network.h"

#include <omp.h>
#include <sha2.h>

#include <algorithm>
#include <cmath>
#include <new>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/dnn.hpp>
#include <regex>

#include "io/read_file.h"

namespace tvsgs::priors {

struct Network::Imported {
    cv::dnn::Net net;
};

namespace {

constexpr std::uintmax_t kMaxBytes = 2147483647;  // protobuf reads no more

std::string sha256_of(const std::string& bytes) {
    char hexadecimal[SHA256_DIGEST_STRING_LENGTH];
    SHA256Data(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size(), hexadecimal);
    return hexadecimal;
}

/// The reason at the end of the module's message, without places in its source.
std::string reason_of(const cv::Exception& error) {
    static const std::regex kPlace(R"(OpenCV\([^)]*\) \S+: error: \(-?\d+:[^)]*\) ?)");
    const std::string text = std::regex_replace(error.err, kPlace, "");
    std::string reason;
    for (const char c : text)
        if (c != '\n' && c != '>') reason += c;
    return std::string(trimmed(reason));
}

/// The module says "Node [Type@domain]:(name) parse error: ..."; of an operator that it does not
/// know, "Can't create layer".
Error import_error(const std::string& path, const cv::Exception& error) {
    static const std::regex kNode(R"(Node \[([^@\]]*)[^\]]*\]:\(([^)]*)\))");
    const std::string version = Network::opencv_version();
    std::smatch node;
    const std::string text = error.what();
    if (!std::regex_search(text, node, kNode))
        return input_error("E_ONNX: ", path, ": OpenCV ", version,
                           " does not import it: ", reason_of(error));
    const std::string op = shown(node[1].str());
    const char* const advice =
        "; expected a network that OpenCV's DNN module runs: build with a newer OpenCV, export it "
        "anew with fixed sizes and simplified (onnxsim), or run it elsewhere and bring its maps";
    if (text.find("Can't create layer") != std::string::npos)
        return input_error("E_ONNX: ", path, ": operator ", op,
                           " is not in the DNN module of OpenCV ", version, advice);
    return input_error("E_ONNX: ", path, ": operator ", op, " (", shown(node[2].str()),
                       ") is used in a way that the DNN module of OpenCV ", version,
                       " does not take: ", reason_of(error), advice);
}

/// Height and width of [1, 3, height, width], or -1 where the file leaves them open.
void check_input(const OnnxFile& file, const std::string& path, int& width, int& height) {
    if (file.inputs.size() != 1)
        throw input_error("E_ONNX: ", path, ": takes ", file.inputs.size(), " inputs, ",
                          text_of(file.inputs), "; expected one, an image (1, 3, height, width)");
    std::vector<std::int64_t> shape = file.inputs[0].shape;
    if (shape.empty()) shape = {-1, -1, -1, -1};  // says nothing
    const bool fits = shape.size() == 4 && std::abs(shape[0]) == 1 &&
                      (shape[1] == 3 || shape[1] == -1) && shape[2] <= 65535 && shape[3] <= 65535;
    if (!fits)
        throw input_error("E_ONNX: ", path, ": takes ", text_of(file.inputs),
                          "; expected an image (1, 3, height, width)",
                          shape.size() == 4 && shape[3] == 3
                              ? ": export it with channels before height and width"
                              : "");
    height = static_cast<int>(shape[2]), width = static_cast<int>(shape[3]);
}

std::string choose_output(const OnnxFile& file, const std::string& path, const std::string& name) {
    if (name.empty() && file.outputs.size() == 1) return file.outputs[0].name;
    for (const OnnxTensor& output : file.outputs)
        if (!name.empty() && output.name == name) return name;
    throw input_error("E_ONNX: ", path, ": has the outputs ", text_of(file.outputs),
                      name.empty()
                          ? "; name one with --output"
                          : str("; expected one of them for --output, found '", shown(name), "'"));
}

}  // namespace

std::string Network::opencv_version() {
    return cv::getVersionString();
}

Network::Network(const std::string& path, const std::string& output)
    : path_(path), imported_(std::make_unique<Imported>()) {
    const std::string bytes = read_bytes(path, kMaxBytes);
    const OnnxFile file = parse_onnx(bytes, path);
    check_input(file, path, width_, height_);
    output_ = choose_output(file, path, output);
    if (!file.weights_file.empty())
        throw input_error("E_ONNX: ", path, ": keeps weights in another file, ",
                          shown(file.weights_file),
                          ", which OpenCV does not read; export it as one file, as onnx.save() of "
                          "the loaded model writes it");
    sha256_ = sha256_of(bytes);
    // What it would log is in its exception.
    cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
    cv::setNumThreads(omp_get_max_threads());
    try {
        imported_->net = cv::dnn::readNetFromONNX(bytes.data(), bytes.size());
        imported_->net.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
        imported_->net.setPreferableTarget(cv::dnn::DNN_TARGET_CPU);
    } catch (const cv::Exception& error) {
        throw import_error(path, error);
    } catch (const std::bad_alloc&) {
        throw;
    } catch (const std::exception& error) {  // of protobuf, as for a node without its inputs
        throw input_error("E_ONNX: ", path, ": is no valid network for OpenCV ", opencv_version(),
                          ": ", error.what(), "; download or export it again");
    }
    if (imported_->net.getLayerId(output_) < 0)
        throw input_error("E_ONNX: ", path, ": OpenCV ", opencv_version(),
                          " has dropped the output '", shown(output_),
                          "' on importing; name another with --output: ", text_of(file.outputs));
}

Network::Network(Network&&) noexcept = default;
Network::~Network() = default;

void Network::require_size(int width, int height) const {
    const auto side = [](int n) { return n < 0 ? std::string("?") : str(n); };
    if ((width_ > 0 && width != width_) || (height_ > 0 && height != height_))
        throw Error(ExitCode::usage,
                    str("E_ONNX: ", path_, ": takes images of ", side(width_), "x", side(height_),
                        " pixels, the size asked for makes ", width, "x", height,
                        "; leave the size out, or export the network for other sizes"));
}

InputSize Network::settled(const InputSize& size, bool of_preset) const {
    const bool fixed = width_ > 0 && height_ > 0;
    if (fixed && (of_preset || size.by == InputSize::By::file)) {
        InputSize own;
        own.by = InputSize::By::both, own.width = width_, own.height = height_;
        return own;
    }
    if (size.by == InputSize::By::file)
        throw Error(ExitCode::usage, str("E_ONNX: ", path_,
                                         ": leaves the size of its input open; give it by --size "
                                         "WIDTHxHEIGHT, --long-side N or --short-side N"));
    if (size.by == InputSize::By::both) require_size(size.width, size.height);
    return size;
}

Tensor Network::run(const std::vector<float>& image, int width, int height) {
    require_size(width, height);
    cv::Mat found;
    try {
        const int shape[4] = {1, 3, height, width};
        imported_->net.setInput(cv::Mat(4, shape, CV_32F, const_cast<float*>(image.data())));
        found = imported_->net.forward(output_);
        if (found.type() != CV_32F) found.convertTo(found, CV_32F);
        if (!found.isContinuous()) found = found.clone();
    } catch (const cv::Exception& error) {
        throw input_error("E_ONNX: ", path_, ": does not run on an image of ", width, "x", height,
                          " in OpenCV ", opencv_version(), ": ", reason_of(error),
                          "; give the size that it was exported for (--size)");
    }
    Tensor tensor;
    for (int i = 0; i < found.dims; ++i) tensor.shape.push_back(found.size[i]);
    const auto* const numbers = found.ptr<float>();
    tensor.numbers.assign(numbers, numbers + found.total());
    const auto bad = std::count_if(tensor.numbers.begin(), tensor.numbers.end(),
                                   [](float n) { return !std::isfinite(n); });
    if (bad > 0)
        throw Error(ExitCode::numerical,
                    str("E_ONNX: ", path_, ": gives NaN or infinity in ", bad, " of ",
                        tensor.numbers.size(), " numbers of '", shown(output_),
                        "'; expected finite ones: check --scale, --mean and --std, or take a file "
                        "of 32-bit weights"));
    return tensor;
}

}  // namespace tvsgs::priors
