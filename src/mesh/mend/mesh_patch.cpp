#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "mesh/mend/mesh_loops.h"

namespace tvsgs {
namespace {

constexpr double kSplit = 1.4142135623730951;  // [Liepa03] uses the square root of 2, too
constexpr int kMaxRounds = 12;                 // each round halves the edges, roughly

double area(Vec3d a, Vec3d b, Vec3d c) {
    const Vec3d ab = b - a, ac = c - a, bc = c - b;
    const double twice = norm(cross(ab, ac));
    const double longest2 = std::max({dot(ab, ab), dot(ac, ac), dot(bc, bc)});
    return twice > 1e-9 * longest2 ? 0.5 * twice : std::numeric_limits<double>::infinity();
}

/// Splits and flips faces; the edges of the loop do not change.
class Refiner {
public:
    Refiner(const HoleBoundary& boundary, Patch& patch)
        : boundary_(boundary), n_(static_cast<int>(boundary.points.size())), patch_(patch) {
        for (int i = 0; i < n_; ++i)
            length_ += norm(boundary.points[(i + 1) % n_] - boundary.points[i]) / n_;
        for (int f = 0; f < static_cast<int>(patch.faces.size()); ++f) enter(f);
    }

    void refine() {
        flip_all();
        for (int round = 0; round < kMaxRounds && split_all(); ++round) flip_all();
    }

private:
    const Vec3d& point(int v) const { return patch_.points[v]; }

    void enter(int f) {
        for (int k = 0; k < 3; ++k) face_of_[{corner(f, k), corner(f, k + 1)}] = f;
    }
    int corner(int f, int k) const { return patch_.faces[f][k % 3]; }

    bool split_all() {
        const std::size_t before = patch_.faces.size();
        for (std::size_t f = 0; f < before; ++f) {
            const Vec3i face = patch_.faces[f];
            const Vec3d middle = (point(face.x) + point(face.y) + point(face.z)) / 3;
            double nearest = std::numeric_limits<double>::infinity();
            for (int k = 0; k < 3; ++k) nearest = std::min(nearest, norm(middle - point(face[k])));
            if (!(kSplit * nearest > length_)) continue;
            const int v = static_cast<int>(patch_.points.size());
            patch_.points.push_back(middle);
            patch_.origins.push_back(face);
            patch_.faces[f] = {face.x, face.y, v};
            patch_.faces.push_back({face.y, face.z, v});
            patch_.faces.push_back({face.z, face.x, v});
            enter(static_cast<int>(f));
            enter(static_cast<int>(patch_.faces.size()) - 2);
            enter(static_cast<int>(patch_.faces.size()) - 1);
        }
        return patch_.faces.size() > before;
    }

    void flip_all() {
        for (int round = 0; round < kMaxRounds; ++round) {
            bool flipped = false;
            for (int f = 0; f < static_cast<int>(patch_.faces.size()); ++f)
                for (int k = 0; k < 3; ++k) flipped |= flip(f, k);
            if (!flipped) return;
        }
    }

    /// Replaces faces abc and bad by adc and dbc if the angles at c and d add up to more than 180
    /// degrees, as a Delaunay triangulation would.
    bool flip(int f, int k) {
        const int a = corner(f, k), b = corner(f, k + 1), c = corner(f, k + 2);
        const auto beside = face_of_.find({b, a});
        if (beside == face_of_.end()) return false;
        const int g = beside->second;
        int d = -1;
        for (int j = 0; j < 3; ++j)
            if (corner(g, j) != a && corner(g, j) != b) d = corner(g, j);
        if (face_of_.count({c, d}) || face_of_.count({d, c})) return false;
        if (c < n_ && d < n_ && !boundary_.may_be_joined(c, d)) return false;
        const Vec3d A = point(a), B = point(b), C = point(c), D = point(d);
        const double sine_c = norm(cross(A - C, B - C)), cosine_c = dot(A - C, B - C),
                     sine_d = norm(cross(A - D, B - D)), cosine_d = dot(A - D, B - D);
        const double lengths = norm(A - C) * norm(B - C) * norm(A - D) * norm(B - D);
        if (!(sine_c * cosine_d + cosine_c * sine_d < -1e-9 * lengths)) return false;
        const Vec3d normal = cross(B - A, C - A) + cross(A - B, D - B);
        if (!(dot(normal, cross(D - A, C - A)) > 0 && dot(normal, cross(B - D, C - D)) > 0) ||
            !std::isfinite(area(A, D, C) + area(D, B, C)))
            return false;
        face_of_.erase({a, b}), face_of_.erase({b, a});
        patch_.faces[f] = {a, d, c}, patch_.faces[g] = {d, b, c};
        enter(f), enter(g);
        return true;
    }

    const HoleBoundary& boundary_;
    const int n_;
    Patch& patch_;
    double length_ = 0;                           // mean of the loop's edges
    std::map<std::pair<int, int>, int> face_of_;  // the face that has the edge in this direction
};

/// Moves the inner points to minimise the sum of squared umbrella vectors over all points. The
/// umbrella vector leads from a point to the mean of its neighbours.
void fair(const HoleBoundary& boundary, Patch& patch) {
    const auto n = static_cast<int>(boundary.points.size()),
               all = static_cast<int>(patch.points.size());
    if (all == n) return;
    std::vector<std::pair<int, int>> joined;
    for (const Vec3i& face : patch.faces)
        for (int k = 0; k < 3; ++k)
            for (const int step : {1, 2}) joined.push_back({face[k], face[(k + step) % 3]});
    std::ranges::sort(joined);
    joined.erase(std::unique(joined.begin(), joined.end()), joined.end());

    std::vector<int> degrees(patch.points.size());
    for (const auto& [v, w] : joined) ++degrees[v];
    for (int v = 0; v < n; ++v) degrees[v] += static_cast<int>(boundary.around[v].size());
    // Each row of U x + known is an umbrella vector.
    std::vector<Eigen::Triplet<double>> entries;
    Eigen::MatrixX3d known = Eigen::MatrixX3d::Zero(all, 3);
    const auto add = [&](int v, int w, double weight) {
        if (w >= n) {
            entries.emplace_back(v, w - n, weight);
        } else {
            const Vec3d p = patch.points[w];
            known.row(v) += weight * Eigen::RowVector3d(p.x, p.y, p.z);
        }
    };
    for (int v = 0; v < all; ++v) add(v, v, -1);
    for (const auto& [v, w] : joined) add(v, w, 1.0 / degrees[v]);
    for (int v = 0; v < n; ++v)
        for (const Vec3d p : boundary.around[v])
            known.row(v) += Eigen::RowVector3d(p.x, p.y, p.z) / degrees[v];
    Eigen::SparseMatrix<double> U(all, all - n);
    U.setFromTriplets(entries.begin(), entries.end());
    const Eigen::SparseMatrix<double> normal = U.transpose() * U;
    const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver(normal);
    const Eigen::MatrixX3d x = solver.solve(-(U.transpose() * known));
    if (solver.info() != Eigen::Success || !x.allFinite()) return;
    for (int v = n; v < all; ++v) patch.points[v] = {x(v - n, 0), x(v - n, 1), x(v - n, 2)};
}

}  // namespace

std::vector<Vec3i> least_area(const HoleBoundary& boundary) {
    const std::vector<Vec3d>& p = boundary.points;
    const std::size_t n = p.size();
    if (n < 3) return {};
    constexpr double kNone = std::numeric_limits<double>::infinity();
    std::vector<double> least(n * n, kNone);  // area of the part from point i to j
    std::vector<std::size_t> third(n * n);    // third corner of the face at edge ij
    for (std::size_t i = 0; i + 1 < n; ++i) least[i * n + i + 1] = 0;
    for (std::size_t span = 2; span < n; ++span)
        for (std::size_t i = 0, j = span; j < n; ++i, ++j) {
            if (span + 1 < n && !boundary.may_be_joined(static_cast<int>(i), static_cast<int>(j)))
                continue;
            for (std::size_t k = i + 1; k < j; ++k) {
                const double others = least[i * n + k] + least[k * n + j];
                if (!(others < least[i * n + j])) continue;
                const double sum = others + area(p[i], p[k], p[j]);
                if (sum < least[i * n + j]) least[i * n + j] = sum, third[i * n + j] = k;
            }
        }
    if (least[n - 1] == kNone) return {};
    std::vector<Vec3i> faces;
    std::vector<std::pair<std::size_t, std::size_t>> pieces{{0, n - 1}};
    while (!pieces.empty()) {
        const auto [i, j] = pieces.back();
        pieces.pop_back();
        if (j < i + 2) continue;
        const std::size_t k = third[i * n + j];
        faces.push_back({static_cast<int>(i), static_cast<int>(k), static_cast<int>(j)});
        pieces.push_back({i, k}), pieces.push_back({k, j});
    }
    return faces;
}

Patch make_patch(const HoleBoundary& boundary) {
    Patch patch{boundary.points, least_area(boundary), {}};
    if (patch.faces.empty()) return patch;
    Refiner(boundary, patch).refine();
    fair(boundary, patch);
    return patch;
}

}  // namespace tvsgs
