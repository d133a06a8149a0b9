// Work is parallel over strips of the image. Eigen must not use threads itself, as its sums would
// depend on their number.
#define EIGEN_DONT_PARALLELIZE
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <limits>

#include "core/device/parallel.h"
#include "core/error.h"
#include "eval/image_metrics.h"
#include "io/files/npz.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

// Pixels of an output strip; its inputs fit into a cache of some MiB.
constexpr int kStripPixels = 4096;
constexpr double kEpsilon = 1e-10;  // added to norms, as in the authors' code

/// Channel major; rows from the top.
struct Features {
    int channels = 0, height = 0, width = 0;
    std::vector<float> values;

    Features() = default;
    Features(int c, int h, int w)
        : channels(c), height(h), width(w), values(std::size_t(c) * h * w) {}
    std::size_t plane() const { return static_cast<std::size_t>(height) * width; }
    const float* row(int c, int y) const {
        return values.data() + c * plane() + static_cast<std::size_t>(y) * width;
    }
    float* row(int c, int y) { return const_cast<float*>(std::as_const(*this).row(c, y)); }
};

/// Normalises colours by the mean and standard deviation of ImageNet.
Features network_input(const ImageF& image, LpipsRange range) {
    constexpr float kShift[] = {-0.030f, -0.088f, -0.188f}, kScale[] = {0.458f, 0.448f, 0.450f};
    Features out(3, image.height, image.width);
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < image.height; ++y)
            for (int x = 0; x < image.width; ++x) {
                const float v = image.at(x, y, c);
                out.row(c, y)[x] =
                    ((range == LpipsRange::zero_one ? v : 2 * v - 1) - kShift[c]) / kScale[c];
            }
    return out;
}

/// Drops windows that would leave the image, as PyTorch does.
Features max_pooled(const Features& in, int edge) {
    Features out(in.channels, (in.height - edge) / 2 + 1, (in.width - edge) / 2 + 1);
    parallel_for_heavy(Cpu{}, in.channels, [&](int c) {
        for (int y = 0; y < out.height; ++y)
            for (int x = 0; x < out.width; ++x) {
                float most = -std::numeric_limits<float>::infinity();
                for (int dy = 0; dy < edge; ++dy)
                    for (int dx = 0; dx < edge; ++dx)
                        most = std::max(most, in.row(c, 2 * y + dy)[2 * x + dx]);
                out.row(c, y)[x] = most;
            }
    });
    return out;
}

using Matrix = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Collects the inputs of the kernel for rows [first, last) of the output: one row per weight of an
/// output channel, one column per pixel; zeros outside of the image.
void gather(
    const Features& in, const LpipsLayer& layer, int first, int last, int width, Matrix& columns) {
    columns.resize(layer.in * layer.kernel * layer.kernel, (last - first) * width);
    float* to = columns.data();
    for (int c = 0; c < layer.in; ++c)
        for (int ky = 0; ky < layer.kernel; ++ky)
            for (int kx = 0; kx < layer.kernel; ++kx)
                for (int y = first; y < last; ++y, to += width) {
                    const int from_y = y * layer.stride + ky - layer.padding;
                    if (from_y < 0 || from_y >= in.height) {
                        std::fill_n(to, width, 0.0f);
                        continue;
                    }
                    const float* const row = in.row(c, from_y);
                    for (int x = 0; x < width; ++x) {
                        const int from_x = x * layer.stride + kx - layer.padding;
                        to[x] = from_x >= 0 && from_x < in.width ? row[from_x] : 0;
                    }
                }
}

/// Convolution as matrix products, with ReLU.
Features convolved(const Features& in,
                   const LpipsLayer& layer,
                   const std::vector<float>& kernel,
                   const std::vector<float>& bias) {
    const auto length = [&](int n) {
        return (n + 2 * layer.padding - layer.kernel) / layer.stride + 1;
    };
    Features out(layer.out, length(in.height), length(in.width));
    const int rows = std::max(1, kStripPixels / out.width);
    const Eigen::Map<const Matrix> weights(kernel.data(), layer.out,
                                           layer.in * layer.kernel * layer.kernel);
    const Eigen::Map<const Eigen::VectorXf> offsets(bias.data(), layer.out);
    parallel_for_heavy(Cpu{}, (out.height + rows - 1) / rows, [&](int strip) {
        const int first = strip * rows, last = std::min(out.height, first + rows);
        Matrix columns;
        gather(in, layer, first, last, out.width, columns);
        Eigen::Map<Matrix, 0, Eigen::OuterStride<>> result(
            out.row(0, first), layer.out, columns.cols(),
            Eigen::OuterStride<>(static_cast<Eigen::Index>(out.plane())));
        result.noalias() = weights * columns;
        result = (result.colwise() + offsets).cwiseMax(0.0f);
    });
    return out;
}

/// Mean over the pixels of the weighted squared differences of unit feature vectors.
double tap_distance(const Features& a, const Features& b, const std::vector<float>& linear) {
    std::vector<double> of_row(static_cast<std::size_t>(a.height));
    parallel_for_heavy(Cpu{}, a.height, [&](int y) {
        double sum = 0;
        for (int x = 0; x < a.width; ++x) {
            double norm_a = 0, norm_b = 0, distance = 0;
            for (int c = 0; c < a.channels; ++c) {
                const double va = a.row(c, y)[x], vb = b.row(c, y)[x];
                norm_a += va * va, norm_b += vb * vb;
            }
            norm_a = std::sqrt(norm_a) + kEpsilon, norm_b = std::sqrt(norm_b) + kEpsilon;
            for (int c = 0; c < a.channels; ++c) {
                const double difference = a.row(c, y)[x] / norm_a - b.row(c, y)[x] / norm_b;
                distance += static_cast<double>(linear[c]) * difference * difference;
            }
            sum += distance;
        }
        of_row[y] = sum;
    });
    double total = 0;
    for (const double sum : of_row) total += sum;
    return total / static_cast<double>(a.plane());
}

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
        } else if (!std::ranges::all_of(tensor->numbers, [&](double v) {
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
            throw input_error("E_LPIPS_WEIGHTS: ", path_, ": ", problems_,
                              "; make the file from PyTorch's as docs/guide/evaluation.md says");
    }

private:
    const NpzArchive& archive_;
    std::string path_, problems_;
};

}  // namespace

const std::vector<LpipsLayer>& lpips_layers(LpipsNet net) {
    static const std::vector<LpipsLayer> vgg = {
        {0, 3, 64, 3, 1, 1, 0, false},     {2, 64, 64, 3, 1, 1, 0, true},
        {5, 64, 128, 3, 1, 1, 2, false},   {7, 128, 128, 3, 1, 1, 0, true},
        {10, 128, 256, 3, 1, 1, 2, false}, {12, 256, 256, 3, 1, 1, 0, false},
        {14, 256, 256, 3, 1, 1, 0, true},  {17, 256, 512, 3, 1, 1, 2, false},
        {19, 512, 512, 3, 1, 1, 0, false}, {21, 512, 512, 3, 1, 1, 0, true},
        {24, 512, 512, 3, 1, 1, 2, false}, {26, 512, 512, 3, 1, 1, 0, false},
        {28, 512, 512, 3, 1, 1, 0, true}};
    static const std::vector<LpipsLayer> alex = {{0, 3, 64, 11, 4, 2, 0, true},
                                                 {3, 64, 192, 5, 1, 2, 3, true},
                                                 {6, 192, 384, 3, 1, 1, 3, true},
                                                 {8, 384, 256, 3, 1, 1, 0, true},
                                                 {10, 256, 256, 3, 1, 1, 0, true}};
    return net == LpipsNet::vgg ? vgg : alex;
}

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

double lpips(const ImageF& a, const ImageF& b, const LpipsWeights& weights, LpipsRange range) {
    if (a.channels != 3 || a.width != b.width || a.height != b.height || b.channels != 3)
        throw Error(ExitCode::internal, "LPIPS: expected two RGB images of one size");
    if (std::min(a.width, a.height) < kLpipsMinEdge) return std::nan("");
    Features fa = network_input(a, range), fb = network_input(b, range);
    const std::vector<LpipsLayer>& layers = lpips_layers(weights.net);
    double distance = 0;
    for (std::size_t i = 0, tap = 0; i < layers.size(); ++i) {
        for (Features* const f : {&fa, &fb}) {
            if (layers[i].pool > 0) *f = max_pooled(*f, layers[i].pool);
            *f = convolved(*f, layers[i], weights.kernels[i], weights.biases[i]);
        }
        if (layers[i].tap) distance += tap_distance(fa, fb, weights.linear[tap++]);
    }
    return distance;
}

}  // namespace tvsgs
