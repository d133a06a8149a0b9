#include <algorithm>

#include "core/scene/scene.h"
#include "mvs/stereo/depth_completion.h"

namespace tvsgs {
namespace {

constexpr int kCell = 5;               // px
constexpr float kSupportCost = 0.1f;   // largest cost of a support point
constexpr float kMaxSideShare = 0.2f;  // of the image's width

/// Support points along the rows of cells, alternating in direction.
std::vector<Vec2<int>> support_points(const Camera& camera,
                                      Span<const float> costs,
                                      const std::vector<std::uint8_t>& mask) {
    std::vector<Vec2<int>> out;
    const int columns = (camera.width_px + kCell - 1) / kCell;
    for (int row = 0; row * kCell < camera.height_px; ++row)
        for (int i = 0; i < columns; ++i) {
            const int column = row % 2 == 0 ? i : columns - 1 - i;
            float least = kSupportCost;
            Vec2<int> best{-1, -1};
            for (int y = row * kCell; y < std::min((row + 1) * kCell, camera.height_px); ++y)
                for (int x = column * kCell; x < std::min((column + 1) * kCell, camera.width_px);
                     ++x) {
                    const std::size_t at = static_cast<std::size_t>(y) * camera.width_px + x;
                    if (costs[at] < least && (mask.empty() || mask[at] >= kObjectMask))
                        least = costs[at], best = {x, y};
                }
            if (best.x >= 0) out.push_back(best);
        }
    return out;
}

int cross(Vec2<int> a, Vec2<int> b) {
    return a.x * b.y - a.y * b.x;
}

using Int = std::int64_t;

/// Twice the signed area of a triangle.
Int area(Vec2<int> a, Vec2<int> b, Vec2<int> c) {
    return Int{b.x - a.x} * (c.y - a.y) - Int{b.y - a.y} * (c.x - a.x);
}

/// True if p lies strictly inside the circle through a, b, c (of positive area).
bool in_circle(Vec2<int> a, Vec2<int> b, Vec2<int> c, Vec2<int> p) {
    const Int ax = a.x - p.x, ay = a.y - p.y, bx = b.x - p.x, by = b.y - p.y, cx = c.x - p.x,
              cy = c.y - p.y;
    return (ax * ax + ay * ay) * (bx * cy - by * cx) - (bx * bx + by * by) * (ax * cy - ay * cx) +
               (cx * cx + cy * cy) * (ax * by - ay * bx) >
           0;
}

/// Incremental triangulation: a fan around each new point replaces the triangles whose circles
/// contain it (Bowyer and Watson).
class Triangulation {
public:
    explicit Triangulation(const std::vector<Vec2<int>>& points) : points_(points) {
        const int count = static_cast<int>(points.size()), s = kMaxTriangulated;
        points_.insert(points_.end(), {{-s, -s}, {4 * s, -s}, {-s, 4 * s}});  // encloses all
        begin_of_.resize(points_.size());
        triangles_.push_back({{count, count + 1, count + 2}, {-1, -1, -1}, -1});
        for (int p = 0; p < count; ++p) add(p);
    }

    std::vector<std::array<int, 3>> result() const {
        const int count = static_cast<int>(points_.size()) - 3;
        std::vector<std::array<int, 3>> out;
        for (const Triangle& t : triangles_)
            if (t.corners[0] < count && t.corners[1] < count && t.corners[2] < count)
                out.push_back(t.corners);
        return out;
    }

private:
    struct Triangle {
        std::array<int, 3> corners;
        std::array<int, 3> beyond;  // triangle across the side opposite each corner; -1: none
        int removed_by;             // last point whose cavity contained it
    };
    struct Side {
        int begin, end, beyond;
    };

    Triangle& triangle(int t) { return triangles_[t]; }
    Vec2<int> point(int p) const { return points_[p]; }

    /// Finds the triangle that contains a point, by walking from the newest one.
    int find(Vec2<int> p) {
        for (int at = newest_;;) {
            const Triangle& t = triangle(at);
            int next = -1;
            for (std::size_t i = 0; i < 3 && next < 0; ++i)
                if (area(point(t.corners[(i + 1) % 3]), point(t.corners[(i + 2) % 3]), p) < 0)
                    next = t.beyond[i];
            if (next < 0) return at;
            at = next;
        }
    }

    void add(int p) {
        // 1. Finds the triangles to remove and the sides around them.
        cavity_.assign(1, find(point(p)));
        triangle(cavity_[0]).removed_by = p;
        sides_.clear();
        for (std::size_t next = 0; next < cavity_.size(); ++next) {
            const Triangle t = triangle(cavity_[next]);
            for (std::size_t i = 0; i < 3; ++i) {
                const int other = t.beyond[i];
                if (other >= 0) {
                    Triangle& o = triangle(other);
                    if (o.removed_by == p) continue;
                    if (in_circle(point(o.corners[0]), point(o.corners[1]), point(o.corners[2]),
                                  point(p))) {
                        o.removed_by = p;
                        cavity_.push_back(other);
                        continue;
                    }
                }
                sides_.push_back({t.corners[(i + 1) % 3], t.corners[(i + 2) % 3], other});
            }
        }
        // 2. Adds one triangle per side, two more than were removed.
        for (std::size_t k = 0; k < sides_.size(); ++k) {
            if (k >= cavity_.size()) {
                cavity_.push_back(static_cast<int>(triangles_.size()));
                triangles_.emplace_back();
            }
            const Side& side = sides_[k];
            triangle(cavity_[k]) = {{side.begin, side.end, p}, {-1, -1, side.beyond}, -1};
            begin_of_[side.begin] = cavity_[k];
            if (side.beyond < 0) continue;
            Triangle& o = triangle(side.beyond);
            for (std::size_t i = 0; i < 3; ++i)
                if (o.corners[(i + 1) % 3] == side.end && o.corners[(i + 2) % 3] == side.begin)
                    o.beyond[i] = cavity_[k];
        }
        for (std::size_t k = 0; k < sides_.size(); ++k) {
            const int after = begin_of_[static_cast<std::size_t>(sides_[k].end)];
            triangle(cavity_[k]).beyond[0] = after;
            triangle(after).beyond[1] = cavity_[k];
        }
        newest_ = cavity_[0];
    }

    std::vector<Vec2<int>> points_;
    std::vector<Triangle> triangles_;
    std::vector<int> begin_of_;  // per point: the new triangle whose side begins there
    std::vector<int> cavity_;
    std::vector<Side> sides_;
    int newest_ = 0;
};

}  // namespace

std::vector<std::array<int, 3>> delaunay(const std::vector<Vec2<int>>& points) {
    return Triangulation(points).result();
}

std::vector<SurfacePlane> planar_prior(const Camera& camera,
                                       Span<const SurfacePlane> planes,
                                       Span<const float> costs,
                                       const std::vector<std::uint8_t>& mask) {
    std::vector<SurfacePlane> prior(planes.size(), SurfacePlane{{0, 0, -1}, 0});
    const std::vector<Vec2<int>> points = support_points(camera, costs, mask);
    const auto index = [&](Vec2<int> p) {
        return static_cast<std::size_t>(p.y) * camera.width_px + p.x;
    };
    const float longest = kMaxSideShare * static_cast<float>(camera.width_px);
    for (const auto& corners : delaunay(points)) {
        Vec2<int> pixel[3];
        Vec3f point[3];
        for (std::size_t k = 0; k < 3; ++k) {
            pixel[k] = points[corners[k]];
            point[k] = planes[index(pixel[k])].depth * pixel_ray(camera, pixel[k].x, pixel[k].y);
        }
        bool wide = false;
        for (int k = 0; k < 3; ++k) {
            const Vec2<int> side = pixel[(k + 1) % 3] - pixel[k];
            wide |= static_cast<float>(side.x * side.x + side.y * side.y) > longest * longest;
        }
        Vec3f normal = cross(point[1] - point[0], point[2] - point[0]);
        if (wide || !(norm(normal) > 0)) continue;
        normal = normalize(normal);
        if (dot(normal, point[0]) > 0) normal = -normal;

        const auto [left, right] = std::minmax({pixel[0].x, pixel[1].x, pixel[2].x});
        const auto [top, bottom] = std::minmax({pixel[0].y, pixel[1].y, pixel[2].y});
        for (int y = top; y <= bottom; ++y)
            for (int x = left; x <= right; ++x) {
                bool inside = true;
                for (int k = 0; k < 3; ++k)
                    inside &= cross(pixel[(k + 1) % 3] - pixel[k], Vec2<int>{x, y} - pixel[k]) >= 0;
                const Vec3f ray = pixel_ray(camera, x, y);
                const float slope = dot(normal, ray);
                if (!inside || !(slope < -kMinFacing)) continue;
                prior[index({x, y})] = {normal, dot(normal, point[0]) / slope};
            }
    }
    return prior;
}

}  // namespace tvsgs
