// What an ONNX file says of its network: inputs, outputs, operators. Weights are passed over.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace tvsgs::priors {

struct OnnxTensor {
    std::string name;
    std::vector<std::int64_t> shape;  // -1: free
};

struct OnnxFile {
    std::vector<OnnxTensor> inputs;      // those that are no weights
    std::vector<OnnxTensor> outputs;     // of the whole network
    std::vector<std::string> operators;  // each once, sorted
    std::string weights_file;            // beside it, which holds weights; empty: none does
};

/// `bytes` of a file; `path` is for messages. Throws Error(ExitCode::input), E_ONNX, for what is no
/// ONNX file, or is cut off.
OnnxFile parse_onnx(std::string_view bytes, const std::string& path);

/// "(1, 3, ?, ?)"
std::string text_of(const std::vector<std::int64_t>& shape);

/// "depth (1, 1, 384, 384), confidence (1, 384, 384)"
std::string text_of(const std::vector<OnnxTensor>& tensors);

}  // namespace tvsgs::priors
