#include "mesh/closed/view_points.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "core/error.h"
#include "mesh/fuse/depth_view.h"
#include "mesh/fuse/pixel_trust.h"

namespace tvsgs {

constexpr int kCellBits = 20;  // of each coordinate
// With everything that is computed from it up to the mesh.
constexpr std::int64_t kBytesOfPoint = 250;

// However large the cells, the 8 cells around the origin and their 8 octants stay separate.
constexpr std::int64_t kMinPoints = 8 * 8;

std::uint64_t ViewPoints::key(Vec3f position, Vec3f normal) const {
    std::uint64_t key = 0;
    for (int axis = 2; axis >= 0; --axis) {
        constexpr double kHalf = 1 << (kCellBits - 1);
        const double cell =
            std::floor(static_cast<double>(position[axis]) / static_cast<double>(cell_)) + kHalf;
        if (!(cell >= 0 && cell < 2 * kHalf))
            throw Error(ExitCode::input, "a surface point at (", position.x, ", ", position.y, ", ",
                        position.z, ") is too far out for voxels of ", cell_,
                        "; lower --depth-max or raise --voxel-size");
        key = key << kCellBits | static_cast<std::uint64_t>(cell);
    }
    const int octant = (normal.x > 0) | (normal.y > 0) << 1 | (normal.z > 0) << 2;
    return key << 3 | static_cast<std::uint64_t>(octant);
}

void ViewPoints::merge(std::vector<Point> points) {
    const auto before = [](const Point& a, const Point& b) { return a.key < b.key; };
    std::ranges::stable_sort(points, before);
    std::vector<Point> all;
    all.reserve(points_.size() + points.size());
    std::ranges::merge(points_, points, std::back_inserter(all), before);
    points_.clear();
    for (const Point& next : all) {
        if (points_.empty() || points_.back().key != next.key) {
            points_.push_back(next);
            continue;
        }
        Point& mean = points_.back();
        mean.pixels += next.pixels;
        const float share = next.pixels / mean.pixels;
        mean.position += share * (next.position - mean.position);
        mean.normal += share * (next.normal - mean.normal);
        mean.color += share * (next.color - mean.color);
    }
}

void ViewPoints::add(const PointView& view) {
    const Camera& camera = view.camera;
    std::vector<Point> found;
    for (std::size_t i = 0; i < view.depth.size(); ++i) {
        if (!(view.depth[i] > 0) || !(view.weight[i] >= kTrustedWeight)) continue;
        const Vec3f n = transpose_times(camera.camera_from_world.R, view.normal[i]);
        if (!(norm(n) > 0) || !is_finite(n)) continue;
        const int pixel = static_cast<int>(i);
        const Vec3f p =
            unproject(camera, pixel % camera.width_px, pixel / camera.width_px, view.depth[i]);
        found.push_back({key(p, n), p, normalize(n), view.color[i], 1});
    }
    merge(std::move(found));
}

void ViewPoints::fit(std::int64_t max_bytes) {
    while (2 * kBytesOfPoint * static_cast<std::int64_t>(points_.size()) > max_bytes) {
        if (std::int64_t(points_.size()) <= kMinPoints)
            throw Error(ExitCode::memory, "a closed surface needs at least ",
                        2 * kBytesOfPoint * kMinPoints, " bytes for its points; ", max_bytes,
                        " are available; raise --memory");
        cell_ *= 2;
        std::vector<Point> points = std::exchange(points_, {});
        for (Point& p : points) p.key = key(p.position, p.normal);
        merge(std::move(points));
    }
}

void ViewPoints::drop_looked_through(const EvidenceSource& evidence) {
    std::vector<SurfaceSample> samples;
    samples.reserve(points_.size());
    for (const Point& p : points_) samples.push_back({p.position, p.normal});
    std::vector<int> through(points_.size());
    const std::vector<Evidence> found =
        gather_evidence(evidence, samples, [&](const std::vector<Judgement>& judged) {
            for (std::size_t i = 0; i < judged.size(); ++i)
                through[i] += judged[i].verdict == Verdict::looks_through;
        });
    std::size_t kept = 0;
    for (std::size_t i = 0; i < points_.size(); ++i)
        if (through[i] == 0 || 2 * through[i] < found[i].sees) points_[kept++] = points_[i];
    dropped_ += points_.size() - kept;
    points_.resize(kept);
}

OrientedPoints ViewPoints::oriented() const {
    OrientedPoints points;
    points.positions.reserve(points_.size()), points.normals.reserve(points_.size());
    for (const Point& p : points_) {
        points.positions.push_back(p.position);
        points.normals.push_back(normalize(p.normal));
    }
    return points;
}

std::vector<Vec3f> ViewPoints::colors() const {
    std::vector<Vec3f> colors;
    colors.reserve(points_.size());
    for (const Point& p : points_) {
        Vec3f c = p.color;
        for (int k = 0; k < 3; ++k) c[k] = c[k] > 0 ? std::min(c[k], 1.0f) : 0;
        colors.push_back(c);
    }
    return colors;
}

}  // namespace tvsgs
