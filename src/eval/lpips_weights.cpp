#include "eval/lpips_weights.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>

#include "core/error.h"
#include "io/files/npz.h"

namespace tvsgs {
namespace {

using Shape = std::vector<std::int64_t>;

std::string text_of(const Shape& shape) {
    std::string text;
    for (const std::int64_t n : shape) text += (text.empty() ? "" : "x") + std::to_string(n);
    return text;
}

const NpyArray* find(const NpzArchive& archive, std::initializer_list<std::string> names) {
    for (const std::string& name : names)
        if (const auto found = archive.find(name); found != archive.end()) return &found->second;
    return nullptr;
}

/// Reads tensors and collects all errors, so that one message names them all.
class Reader {
public:
    Reader(const NpzArchive& archive, const std::string& path) : archive_(archive), path_(path) {}

    /// Returns the tensor under the first existing name of `names`; empty, with an error, if it
    /// cannot be used.
    std::vector<float> read(std::initializer_list<std::string> names,
                            const Shape& shape,
                            bool may_be_negative = true) {
        const NpyArray* const tensor = find(archive_, names);
        const std::string& name = *names.begin();
        if (!tensor) {
            complain(name + " is missing");
        } else if (tensor->shape != shape) {
            complain(
                str(name, " has shape ", text_of(tensor->shape), ", expected ", text_of(shape)));
        } else if (!std::all_of(tensor->numbers.begin(), tensor->numbers.end(), [&](double v) {
                       return std::isfinite(v) && (may_be_negative || v >= 0);
                   })) {
            complain(str(name, may_be_negative ? " is not finite" : " is negative or not finite"));
        } else {
            return {tensor->numbers.begin(), tensor->numbers.end()};
        }
        return {};
    }
    void complain(const std::string& what) { problems_ += (problems_.empty() ? "" : "; ") + what; }
    void finish() const {
        if (!problems_.empty())
            throw Error(ExitCode::input,
                        str("E_LPIPS_WEIGHTS: ", path_, ": ", problems_,
                            "; make the file from PyTorch's as docs/guide/evaluation.md says"));
    }

private:
    const NpzArchive& archive_;
    std::string path_, problems_;
};

}  // namespace

LpipsWeights read_lpips_weights(const std::string& path) {
    const NpzArchive archive = read_tensors(path);
    Reader reader(archive, path);
    const auto convolution = [](int index, const char* part) {
        return str("features.", index, ".", part);
    };
    const NpyArray* const first =
        find(archive, {convolution(0, "weight"), "net." + convolution(0, "weight")});
    if (!first) reader.complain(convolution(0, "weight") + " is missing"), reader.finish();
    LpipsWeights weights;
    // The kernels of the first convolution are 11 wide in AlexNet and 3 wide in VGG.
    weights.net =
        first->shape.size() == 4 && first->shape[3] == 11 ? LpipsNet::alex : LpipsNet::vgg;
    for (const LpipsLayer& layer : lpips_layers(weights.net)) {
        const std::string kernel = convolution(layer.index, "weight"),
                          bias = convolution(layer.index, "bias");
        weights.kernels.push_back(reader.read({kernel, "net." + kernel},
                                              {layer.out, layer.in, layer.kernel, layer.kernel}));
        weights.biases.push_back(reader.read({bias, "net." + bias}, {layer.out}));
        if (!layer.tap) continue;
        const std::string linear = str("lin", weights.linear.size());
        weights.linear.push_back(reader.read({linear + ".model.1.weight", linear + ".weight"},
                                             {1, layer.out, 1, 1}, false));
    }
    reader.finish();
    return weights;
}

}  // namespace tvsgs
