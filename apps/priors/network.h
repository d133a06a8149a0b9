// A network of an ONNX file, run by OpenCV's DNN module on the CPU.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "apps/priors/onnx_file.h"
#include "apps/priors/recipe.h"

namespace tvsgs::priors {

/// Numbers in row-major order.
struct Tensor {
    std::vector<std::int64_t> shape;
    std::vector<float> numbers;  // [product of shape]
};

class Network {
public:
    /// Reads the file and has the module import it. `output` is the name of the wanted output; may
    /// be empty where there is one. Throws Error(ExitCode::input), E_ONNX: no ONNX file; other than
    /// one input [1, 3, height, width]; no such output, naming those there are; an operator that
    /// the module lacks, or does not take as it is used, named; weights in another file.
    Network(const std::string& path, const std::string& output);
    Network(Network&&) noexcept;
    ~Network();

    const std::string& sha256() const { return sha256_; }  // of the file, in hexadecimal
    const std::string& output() const { return output_; }
    /// `size` where the file leaves its input open; the file's where it fixes that and `size` is of
    /// a preset, or says to take the file's. Throws Error(ExitCode::usage) where neither says it,
    /// or both say it and differ.
    InputSize settled(const InputSize& size, bool of_preset) const;

    /// The output for an image [3, height, width]. Throws Error(ExitCode::input), E_ONNX, with the
    /// module's reason where the network does not run at that size, Error(ExitCode::numerical)
    /// where it gives NaN or infinity.
    Tensor run(const std::vector<float>& image, int width, int height);

    /// "4.6.0"
    static std::string opencv_version();

private:
    struct Imported;
    void require_size(int width, int height) const;

    std::string path_, sha256_, output_;
    int width_ = -1, height_ = -1;  // of the input; -1: free
    std::unique_ptr<Imported> imported_;
};

}  // namespace tvsgs::priors
