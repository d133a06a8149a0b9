#include "optim/color_drift.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace tvsgs {
namespace {

using Pairs = std::vector<std::pair<Vec3d, Vec3d>>;
using Row = std::array<double, 4>;

Row homogeneous(Vec3d c) {
    return {c.x, c.y, c.z, 1};
}

/// Solves M x = b for symmetric positive definite M, by Cholesky's factors in its place.
Row solve(std::array<Row, 4> M, Row b) {
    for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t j = 0; j <= i; ++j) {
            for (std::size_t k = 0; k < j; ++k) M[i][j] -= M[i][k] * M[j][k];
            M[i][j] = i == j ? std::sqrt(M[i][i]) : M[i][j] / M[j][j];
        }
    for (std::size_t i = 0; i < 4; ++i) {
        for (std::size_t k = 0; k < i; ++k) b[i] -= M[i][k] * b[k];
        b[i] /= M[i][i];
    }
    for (std::size_t i = 4; i-- > 0;) {
        for (std::size_t k = i + 1; k < 4; ++k) b[i] -= M[k][i] * b[k];
        b[i] /= M[i][i];
    }
    return b;
}

struct Fit {
    double gain = 1, offset = 0;
    std::array<Row, 3> matrix{};

    Vec3d residual(const std::pair<Vec3d, Vec3d>& pair, bool with_matrix) const {
        Vec3d r;
        const Row c = homogeneous(pair.first);
        for (int row = 0; row < 3; ++row) {
            r[row] = pair.second[row] - gain * pair.first[row] - offset;
            for (std::size_t k = 0; with_matrix && k < 4; ++k)
                r[row] -= matrix[static_cast<std::size_t>(row)][k] * c[k];
        }
        return r;
    }
};

/// To every second pair from `first` on.
Fit fit(const Pairs& pairs, std::size_t first) {
    double n = 0, a = 0, b = 0, aa = 0, ab = 0;
    for (std::size_t i = first; i < pairs.size(); i += 2)
        for (int c = 0; c < 3; ++c) {
            const double x = pairs[i].first[c], y = pairs[i].second[c];
            n += 1, a += x, b += y, aa += x * x, ab += x * y;
        }
    Fit f;
    const double spread = aa - a * a / n;
    if (spread > 1e-9 * n) f.gain = (ab - a * b / n) / spread;
    f.offset = (b - f.gain * a) / n;
    // What is left, by the matrix. Greys do not tell its columns apart: a little holds it at none.
    std::array<Row, 4> normal{};
    std::array<Row, 3> right{};
    for (std::size_t i = first; i < pairs.size(); i += 2) {
        const Row c = homogeneous(pairs[i].first);
        const Vec3d r = f.residual(pairs[i], false);
        for (std::size_t j = 0; j < 4; ++j) {
            for (std::size_t k = 0; k < 4; ++k) normal[j][k] += c[j] * c[k];
            for (std::size_t row = 0; row < 3; ++row)
                right[row][j] += r[static_cast<int>(row)] * c[j];
        }
    }
    for (std::size_t j = 0; j < 4; ++j) normal[j][j] += 1e-3 * n;
    for (std::size_t row = 0; row < 3; ++row) f.matrix[row] = solve(normal, right[row]);
    return f;
}

}  // namespace

double color_drift(const Pairs& pairs) {
    constexpr std::size_t kLeast = 60;
    if (pairs.size() < kLeast) return std::numeric_limits<double>::quiet_NaN();
    double by_gain = 0, by_matrix = 0, color = 0;
    for (const std::size_t half : {0, 1}) {
        const Fit f = fit(pairs, half);
        for (std::size_t i = 1 - half; i < pairs.size(); i += 2)
            for (int c = 0; c < 3; ++c) {
                by_gain += std::abs(f.residual(pairs[i], false)[c]);
                by_matrix += std::abs(f.residual(pairs[i], true)[c]);
                color += pairs[i].second[c];
            }
    }
    return color > 0 ? std::max(0.0, by_gain - by_matrix) / color : 0;
}

}  // namespace tvsgs
