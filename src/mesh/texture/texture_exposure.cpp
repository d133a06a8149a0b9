#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>

#include "core/device/parallel.h"
#include "mesh/texture/texture_steps.h"

namespace tvsgs::texture {
namespace {

constexpr double kOutlier = 3, kMinDeviation = 0.02;  // in deviations; of colours in [0, 1]
constexpr float kDark = 0.05f, kBright = 0.95f;       // colours outside say little about exposure
constexpr double kMaxGain = 4;
constexpr int kMaxCompared = 20000;  // faces, spread over the mesh
constexpr int kMaxPartners = 8;      // of a view of a face

float median_of(Span<float> values) {
    float* const middle = values.data + values.count / 2;
    std::nth_element(values.data, middle, values.data + values.count);
    return *middle;
}

/// A colour farther than `limit` from the median of the candidates is an outlier.
struct ColorBounds {
    Vec3f middle;
    double limit = INFINITY;

    explicit ColorBounds(Span<const Candidate> of) {
        if (of.count < 4) return;
        float numbers[kMaxCandidates];
        const Span<float> values{numbers, std::min(of.count, kMaxCandidates)};
        for (int c = 0; c < 3; ++c) {
            for (std::size_t i = 0; i < values.count; ++i) values[i] = of[i].color[c];
            middle[c] = median_of(values);
        }
        for (std::size_t i = 0; i < values.count; ++i) values[i] = norm(of[i].color - middle);
        // 1.4826: ratio of the deviation to the median for normal errors.
        limit = kOutlier * std::max(1.4826 * double{median_of(values)}, kMinDeviation);
    }
    bool hold(Vec3f color) const { return double{norm(color - middle)} <= limit; }
};

}  // namespace

void level_exposures(Candidates& candidates, std::vector<PhotoView>& views) {
    // 1. For each pair of views, the logarithms of the ratios of their colours on common faces.
    std::map<std::pair<int, int>, std::vector<Vec3f>> ratios;
    const auto tells = [](Vec3f color) {
        return std::min({color.x, color.y, color.z}) > kDark &&
               std::max({color.x, color.y, color.z}) < kBright;
    };
    const int step = std::max(1, candidates.faces() / kMaxCompared);
    for (int f = 0; f < candidates.faces(); f += step) {
        const Span<const Candidate> of = candidates.of(f);
        for (std::size_t i = 0; i < of.count; ++i)
            for (std::size_t j = i + 1; j < std::min(of.count, i + 1 + kMaxPartners); ++j) {
                if (!tells(of[i].color) || !tells(of[j].color)) continue;
                Vec3f ratio;
                for (int c = 0; c < 3; ++c) ratio[c] = std::log(of[i].color[c] / of[j].color[c]);
                ratios[{of[i].view, of[j].view}].push_back(ratio);
            }
    }
    // 2. Logarithms of the gains, per channel: gain_i - gain_j = -median, weighted by the number of
    // ratios.
    const auto count = static_cast<Eigen::Index>(views.size());
    Eigen::MatrixXd A = Eigen::MatrixXd::Zero(count, count), b = Eigen::MatrixXd::Zero(count, 3);
    for (auto& [pair, list] : ratios) {
        const auto [i, j] = pair;
        const auto weight = static_cast<double>(list.size());
        A(i, i) += weight, A(j, j) += weight, A(i, j) -= weight, A(j, i) -= weight;
        for (int c = 0; c < 3; ++c) {
            std::vector<float> values;
            for (const Vec3f ratio : list) values.push_back(ratio[c]);
            const double median = double{median_of({values.data(), values.size()})};
            b(i, c) -= weight * median, b(j, c) += weight * median;
        }
    }
    // A view without partners keeps its exposure.
    for (Eigen::Index i = 0; i < count; ++i) A(i, i) += 1;
    const Eigen::MatrixXd gains = A.ldlt().solve(b);
    const double most = std::log(kMaxGain);
    for (Eigen::Index i = 0; i < count; ++i)
        for (int c = 0; c < 3; ++c)
            views[i].gain[c] = static_cast<float>(std::exp(std::clamp(gains(i, c), -most, most)));
    parallel_for(Cpu{}, candidates.faces(), [&](int f) {
        for (std::size_t i = candidates.begin[f]; i < candidates.begin[f + 1]; ++i)
            candidates.all[i].color = views[candidates.all[i].view].gain * candidates.all[i].color;
    });
}

void drop_outliers(Candidates& candidates) {
    std::vector<char> stay(candidates.all.size());
    parallel_for(Cpu{}, candidates.faces(), [&](int f) {
        const ColorBounds bounds(candidates.of(f));
        for (std::size_t i = candidates.begin[f]; i < candidates.begin[f + 1]; ++i)
            stay[i] = bounds.hold(candidates.all[i].color);
    });
    candidates.keep(stay);
}

}  // namespace tvsgs::texture
