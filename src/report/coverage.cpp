#include <algorithm>
#include <array>
#include <cmath>

#include "core/math/sigmoid.h"
#include "report/report.h"

namespace tvsgs {
namespace {

constexpr std::size_t kMaxSamples = 200'000;
constexpr int kCells = 64;       // along the longer side of a view
constexpr float kOpaque = 0.5f;  // splats below this opacity hide little
// Relative depth tolerance to the nearest sample of a cell, for slanted surfaces.
constexpr float kBehind = 1.05f;
constexpr double kLink = 0.1;     // views that share less are not linked
constexpr double kOneSide = 0.6;  // share in one half of the view that names that side

struct Grid {
    int columns, rows;
    std::vector<int> front;  // [rows columns] index of the nearest sample; -1: none
};

std::vector<Vec3f> opaque_centres(const Gaussians<Cpu>& splats) {
    std::vector<float> opacities;
    for (std::size_t i = 0; i < splats.means.size(); ++i)
        opacities.push_back(sigmoid(splats.opacity_logits[i]));
    if (opacities.empty()) return {};
    // Splats of a short training are transparent: use the more opaque half.
    std::vector<float> sorted = opacities;
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    const float least = std::min(kOpaque, *middle);
    std::vector<Vec3f> all;
    for (std::size_t i = 0; i < splats.means.size(); ++i)
        if (opacities[i] >= least && is_finite(splats.means[i])) all.push_back(splats.means[i]);
    if (all.size() <= kMaxSamples) return all;
    std::vector<Vec3f> some(kMaxSamples);
    for (std::size_t i = 0; i < kMaxSamples; ++i) some[i] = all[i * all.size() / kMaxSamples];
    return some;
}

/// Finds the nearest samples of a view; calls `sees` with each sample that is not hidden.
template <class Sees>
Grid look(const Camera& camera, const std::vector<Vec3f>& samples, const Sees& sees) {
    const double scale = static_cast<double>(kCells) / std::max(camera.width_px, camera.height_px);
    const auto cells = [&](int n) { return std::max(1, static_cast<int>(std::lround(n * scale))); };
    const Camera small = scaled_camera(camera, cells(camera.width_px), cells(camera.height_px));
    Grid grid{small.width_px, small.height_px, {}};
    grid.front.assign(static_cast<std::size_t>(grid.columns) * grid.rows, -1);
    std::vector<float> nearest(grid.front.size(), INFINITY), depth(samples.size());
    std::vector<int> cell(samples.size(), -1);
    for (std::size_t i = 0; i < samples.size(); ++i) {
        if (!is_in_view(small, samples[i])) continue;
        const Vec3f p = small.camera_from_world * samples[i];
        const int x = static_cast<int>(small.fx_px * p.x / p.z + small.cx_px),
                  y = static_cast<int>(small.fy_px * p.y / p.z + small.cy_px);
        cell[i] = y * grid.columns + x, depth[i] = p.z;
        const auto c = static_cast<std::size_t>(cell[i]);
        if (p.z < nearest[c]) nearest[c] = p.z, grid.front[c] = static_cast<int>(i);
    }
    for (std::size_t i = 0; i < samples.size(); ++i)
        if (cell[i] >= 0 && depth[i] <= kBehind * nearest[static_cast<std::size_t>(cell[i])])
            sees(i);
    return grid;
}

double angle_deg(Vec3f at, Vec3f a, Vec3f b) {
    const Vec3d u = vec_cast<double>(a - at), v = vec_cast<double>(b - at);
    const double lengths = norm(u) * norm(v);
    return lengths > 0 ? std::acos(std::clamp(dot(u, v) / lengths, -1.0, 1.0)) * 180 / M_PI : 0;
}

/// Overlap of two training views.
struct Pair {
    int shared = 0;     // number of cells of the first view whose sample the second view sees
    double angles = 0;  // sum of their angles, degrees
};

class Coverage {
public:
    Coverage(const Gaussians<Cpu>& splats, const std::vector<ViewCamera>& cameras)
        : samples_(opaque_centres(splats)), seen_by_(samples_.size()) {
        for (const ViewCamera& camera : cameras) (camera.test ? test_ : train_).push_back(&camera);
    }

    JsonValue json() {
        if (train_.empty() || train_.size() > kMaxCoverageViews) return {};
        compare_pairs();
        JsonValue views = JsonValue::list();
        int cells = 0, lone = 0;
        for (std::size_t v = 0; v < train_.size(); ++v) {
            cells += cells_[v], lone += halves_[v][4];
            views.items.push_back(view_json(v));
        }
        if (cells == 0) return {};
        return JsonValue()
            .add("two", 1 - static_cast<double>(lone) / cells)
            .add("views", std::move(views))
            .add("gap", gap_json())
            .add("test", test_json());
    }

private:
    Pair& pair(std::size_t a, std::size_t b) { return pairs_[a * train_.size() + b]; }
    double shared(std::size_t a, std::size_t b) {
        return cells_[a] > 0 ? static_cast<double>(pair(a, b).shared) / cells_[a] : 0;
    }

    void compare_pairs() {
        const std::size_t n = train_.size();
        std::vector<Grid> grids;
        for (std::size_t v = 0; v < n; ++v)
            grids.push_back(look(train_[v]->camera, samples_, [&](std::size_t i) {
                seen_by_[i].push_back(static_cast<int>(v));
            }));
        pairs_.resize(n * n), cells_.resize(n), halves_.resize(n);
        for (std::size_t v = 0; v < n; ++v) {
            const Vec3f centre = camera_centre(train_[v]->camera);
            for (std::size_t c = 0; c < grids[v].front.size(); ++c) {
                if (grids[v].front[c] < 0) continue;
                const auto i = static_cast<std::size_t>(grids[v].front[c]);
                ++cells_[v];
                for (const int w : seen_by_[i]) {
                    const auto other = static_cast<std::size_t>(w);
                    if (other == v) continue;
                    ++pair(v, other).shared;
                    pair(v, other).angles +=
                        angle_deg(samples_[i], centre, camera_centre(train_[other]->camera));
                }
                if (seen_by_[i].size() > 1) continue;
                const int x = static_cast<int>(c) % grids[v].columns,
                          y = static_cast<int>(c) / grids[v].columns;
                ++halves_[v][2 * x < grids[v].columns ? 0 : 1];
                ++halves_[v][2 * y < grids[v].rows ? 2 : 3];
                ++halves_[v][4];
            }
        }
    }

    JsonValue view_json(std::size_t v) {
        const int lone = halves_[v][4];
        const auto most = std::max_element(halves_[v].begin(), halves_[v].begin() + 4);
        static constexpr std::array<const char*, 4> kSides{"left", "right", "upper", "lower"};
        const auto side = static_cast<std::size_t>(most - halves_[v].begin());
        JsonValue json;
        json.add("name", train_[v]->name)
            .add("lone", cells_[v] > 0 ? static_cast<double>(lone) / cells_[v] : 1.0)
            .add("side", lone > 0 && *most >= kOneSide * lone ? kSides[side] : "");
        std::size_t best = v;
        for (std::size_t w = 0; w < train_.size(); ++w)
            if (w != v && (best == v || shared(v, w) > shared(v, best))) best = w;
        if (best != v) json.add("partner", train_[best]->name).add("shared", shared(v, best));
        return json;
    }

    /// The weakest link of Prim's tree by angle. Views that share too little are linked last, by
    /// their share.
    JsonValue gap_json() {
        const std::size_t n = train_.size();
        const auto angle = [&](std::size_t a, std::size_t b) {
            const int both = pair(a, b).shared + pair(b, a).shared;
            return both > 0 ? (pair(a, b).angles + pair(b, a).angles) / both : NAN;
        };
        const auto least = [&](std::size_t a, std::size_t b) {
            return std::min(shared(a, b), shared(b, a));
        };
        const auto cost = [&](std::size_t a, std::size_t b) {
            return least(a, b) >= kLink ? angle(a, b) : 1000 - 100 * least(a, b);
        };
        std::vector<std::size_t> from(n, 0);
        std::vector<bool> joined(n, false);
        joined[0] = true;
        std::size_t a = 0, b = 0;
        for (std::size_t count = 1; count < n; ++count) {
            std::size_t next = n;
            for (std::size_t v = 0; v < n; ++v)
                if (!joined[v] && (next == n || cost(from[v], v) < cost(from[next], next)))
                    next = v;
            if (a == b || cost(from[next], next) > cost(a, b)) a = from[next], b = next;
            joined[next] = true;
            for (std::size_t v = 0; v < n; ++v)
                if (!joined[v] && cost(next, v) < cost(from[v], v)) from[v] = next;
        }
        if (a == b) return {};
        return JsonValue()
            .add("a", train_[std::min(a, b)]->name)
            .add("b", train_[std::max(a, b)]->name)
            .add("angle_deg", angle(a, b))
            .add("shared", least(a, b));
    }

    JsonValue test_json() const {
        JsonValue list = JsonValue::list();
        for (const ViewCamera* test : test_) {
            const Grid grid = look(test->camera, samples_, [](std::size_t) {});
            Vec3d sum;
            int count = 0;
            for (const int i : grid.front)
                if (i >= 0) sum += vec_cast<double>(samples_[static_cast<std::size_t>(i)]), ++count;
            if (count == 0) continue;
            const Vec3f middle = vec_cast<float>(sum / count), at = camera_centre(test->camera);
            double best = INFINITY;
            const ViewCamera* nearest = nullptr;
            for (const ViewCamera* train : train_)
                if (const double a = angle_deg(middle, at, camera_centre(train->camera)); a < best)
                    best = a, nearest = train;
            if (nearest == nullptr) continue;
            list.items.push_back(JsonValue()
                                     .add("name", test->name)
                                     .add("nearest", nearest->name)
                                     .add("angle_deg", best));
        }
        return list;
    }

    std::vector<const ViewCamera*> train_, test_;
    std::vector<Vec3f> samples_;
    std::vector<std::vector<int>> seen_by_;  // training views, per sample
    std::vector<Pair> pairs_;                // [n n]
    std::vector<int> cells_;                 // cells with a sample, per training view
    // Single-view cells: left, right, upper, lower half, all.
    std::vector<std::array<int, 5>> halves_;
};

}  // namespace

JsonValue coverage_json(const Gaussians<Cpu>& splats, const std::vector<ViewCamera>& cameras) {
    return Coverage(splats, cameras).json();
}

}  // namespace tvsgs
