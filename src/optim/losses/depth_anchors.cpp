#include "optim/losses/depth_anchors.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace tvsgs {
namespace {

constexpr std::size_t kBest = 30, kFirst = 15, kSpread = 5;  // 20 anchors

/// `count` of the candidates: the first, then always the one farthest from all chosen ones.
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
        taken.push_back(farthest);  // exists, as all candidates differ
    }
    return taken;
}

}  // namespace

std::vector<int> choose_anchors(int width, const std::vector<float>& confidence) {
    std::vector<int> pixels;
    for (std::size_t i = 0; i < confidence.size(); ++i)
        if (confidence[i] > kAnchorConfidence) pixels.push_back(int(i));
    if (pixels.size() < kBest) return {};
    const auto better = [&](int a, int b) {
        const float ca = confidence[a], cb = confidence[b];
        return ca != cb ? ca > cb : a < b;
    };
    std::partial_sort(pixels.begin(), pixels.begin() + kBest, pixels.end(), better);
    std::vector<int> anchors(pixels.begin(), pixels.begin() + kFirst);
    const std::vector<int> next(pixels.begin() + kFirst, pixels.begin() + kBest);
    for (const int pixel : spread_out(next, kSpread, width)) anchors.push_back(pixel);
    return anchors;
}

std::optional<AffineFit> fit_affine(const std::vector<double>& prior,
                                    const std::vector<double>& depth) {
    if (prior.size() < kLeastAnchors) return {};
    // Sums about the means keep their digits.
    const double count = double(prior.size());
    double mean_prior = 0, mean_depth = 0;
    for (std::size_t i = 0; i < prior.size(); ++i) mean_prior += prior[i], mean_depth += depth[i];
    mean_prior /= count, mean_depth /= count;
    double variance = 0, covariance = 0;
    for (std::size_t i = 0; i < prior.size(); ++i) {
        const double d = prior[i] - mean_prior;
        variance += d * d;
        covariance += d * (depth[i] - mean_depth);
    }
    if (!(variance / count > 1e-6) || !std::isfinite(covariance)) return {};
    const double slope = covariance / variance;
    if (!(slope > 0)) return {};
    return AffineFit{slope, mean_depth - slope * mean_prior};
}

DepthAlignment<double> align(const AffineFit& fit,
                             const std::vector<double>& prior,
                             const std::vector<double>& depth,
                             int nearest) {
    std::vector<double> errors;
    for (std::size_t i = 0; i < prior.size(); ++i)
        errors.push_back(depth[i] - (fit.slope * prior[i] + fit.offset));
    const auto smaller = [](double a, double b) { return std::abs(a) < std::abs(b); };
    std::ranges::sort(errors, smaller);
    const auto count = std::min(std::size_t(std::max(nearest, 1)), errors.size());
    const double sum = std::accumulate(errors.begin(), errors.begin() + std::ptrdiff_t(count), 0.0);
    return {fit.slope, fit.offset, std::abs(errors.back()), sum / double(count)};
}

}  // namespace tvsgs
