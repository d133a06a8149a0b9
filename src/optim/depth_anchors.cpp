#include "optim/depth_anchors.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace tvsgs {
namespace {

constexpr std::size_t kBest = 30, kFirst = 15, kSpread = 5;  // 20 anchors
constexpr int kColumns = 8, kRows = 6;

/// `count` of the candidates: the first one, then always the one farthest from those taken.
std::vector<int> spread_out(const std::vector<int>& candidates, std::size_t count, int width) {
    std::vector<int> taken{candidates.front()};
    while (taken.size() < count) {
        int farthest = -1;
        std::int64_t most = 0;
        for (const int c : candidates) {
            std::int64_t nearest = INT64_MAX;
            for (const int t : taken) {
                const std::int64_t dx = c % width - t % width, dy = c / width - t / width;
                nearest = std::min(nearest, dx * dx + dy * dy);
            }
            if (nearest > most) most = nearest, farthest = c;
        }
        taken.push_back(farthest);  // candidates differ, so there is one
    }
    return taken;
}

std::vector<int> best_thirty(int width, const std::vector<float>& confidence) {
    std::vector<int> pixels;
    for (std::size_t i = 0; i < confidence.size(); ++i)
        if (confidence[i] > kAnchorConfidence) pixels.push_back(static_cast<int>(i));
    if (pixels.size() < kBest) return {};
    const auto better = [&](int a, int b) {
        const float ca = confidence[static_cast<std::size_t>(a)],
                    cb = confidence[static_cast<std::size_t>(b)];
        return ca != cb ? ca > cb : a < b;
    };
    std::partial_sort(pixels.begin(), pixels.begin() + kBest, pixels.end(), better);
    std::vector<int> anchors(pixels.begin(), pixels.begin() + kFirst);
    const std::vector<int> next(pixels.begin() + kFirst, pixels.begin() + kBest);
    for (const int pixel : spread_out(next, kSpread, width)) anchors.push_back(pixel);
    return anchors;
}

std::vector<int> best_of_cells(int width, int height, const std::vector<float>& confidence) {
    std::vector<int> best(kColumns * kRows, -1);
    for (std::size_t i = 0; i < confidence.size(); ++i) {
        if (!(confidence[i] > kCellConfidence)) continue;
        const int at = static_cast<int>(i), column = at % width * kColumns / width,
                  row = at / width * kRows / height;
        int& cell = best[static_cast<std::size_t>(row * kColumns + column)];
        if (cell < 0 || confidence[i] > confidence[static_cast<std::size_t>(cell)]) cell = at;
    }
    std::erase(best, -1);
    if (best.size() < kLeastAnchors) best.clear();
    return best;
}

double median(std::vector<double> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

/// Weighted least squares about the means; false where the priors hardly differ, or are no numbers.
bool solve(const std::vector<double>& prior, const std::vector<double>& depth, AffineFit& fit) {
    double sum = 0, mean_prior = 0, mean_depth = 0;
    for (std::size_t i = 0; i < prior.size(); ++i) {
        sum += fit.weights[i];
        mean_prior += fit.weights[i] * prior[i], mean_depth += fit.weights[i] * depth[i];
    }
    mean_prior /= sum, mean_depth /= sum;
    double variance = 0, covariance = 0;
    for (std::size_t i = 0; i < prior.size(); ++i) {
        const double d = prior[i] - mean_prior;
        variance += fit.weights[i] * d * d;
        covariance += fit.weights[i] * d * (depth[i] - mean_depth);
    }
    if (!(variance / sum > 1e-6) || !std::isfinite(covariance)) return false;
    fit.slope = covariance / variance;
    fit.offset = mean_depth - fit.slope * mean_prior;
    return true;
}

}  // namespace

std::vector<int> choose_anchors(AnchorChoice choice,
                                int width,
                                int height,
                                const std::vector<float>& confidence) {
    return choice == AnchorChoice::top30 ? best_thirty(width, confidence)
                                         : best_of_cells(width, height, confidence);
}

std::optional<AffineFit> fit_affine(AnchorFit kind,
                                    const std::vector<double>& prior,
                                    const std::vector<double>& depth) {
    if (prior.size() < kLeastAnchors) return {};
    AffineFit fit;
    fit.weights.assign(prior.size(), 1);
    if (!solve(prior, depth, fit)) return {};
    for (int round = 0; kind == AnchorFit::irls && round < 5; ++round) {
        std::vector<double> errors;
        for (std::size_t i = 0; i < prior.size(); ++i)
            errors.push_back(std::abs(depth[i] - (fit.slope * prior[i] + fit.offset)));
        // 95 % as efficient as least squares where errors are normal.
        const double limit = 1.345 * 1.4826 * median(errors);
        if (!(limit > 0)) break;  // most anchors are met exactly
        for (std::size_t i = 0; i < errors.size(); ++i)
            fit.weights[i] = errors[i] <= limit ? 1 : limit / errors[i];
        if (!solve(prior, depth, fit)) return {};
    }
    if (!(fit.slope > 0)) return {};
    return fit;
}

DepthAlignment<double> align(const AffineFit& fit,
                             const std::vector<double>& prior,
                             const std::vector<double>& depth,
                             int nearest) {
    std::vector<double> errors;
    for (std::size_t i = 0; i < prior.size(); ++i)
        if (fit.weights[i] == 1) errors.push_back(depth[i] - (fit.slope * prior[i] + fit.offset));
    // The median error is within the limit, so there are some.
    const auto smaller = [](double a, double b) { return std::abs(a) < std::abs(b); };
    std::sort(errors.begin(), errors.end(), smaller);
    const auto count = std::min(static_cast<std::size_t>(std::max(nearest, 1)), errors.size());
    const double sum =
        std::accumulate(errors.begin(), errors.begin() + static_cast<std::ptrdiff_t>(count), 0.0);
    return {fit.slope, fit.offset, std::abs(errors.back()), sum / static_cast<double>(count)};
}

}  // namespace tvsgs
