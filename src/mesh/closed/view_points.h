// Converts depth maps to oriented points.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/camera.h"
#include "mesh/closed/poisson.h"
#include "mesh/mend/mesh_evidence.h"

namespace tvsgs {

/// A depth map on the host, with the weights of mesh/fuse/pixel_trust.h.
struct PointView {
    Camera camera;
    std::vector<float> depth;   // [H W] z-depth; 0: none
    std::vector<Vec3f> color;   // [H W]
    std::vector<float> weight;  // [H W]
    std::vector<Vec3f> normal;  // [H W] camera frame, facing the camera, of any length
};

/// Points of many depth maps: one for each grid cell and octant of the normal, the mean of the
/// pixels there. Sorted by cell.
class ViewPoints {
public:
    /// `cell`: edge length, world units, > 0.
    explicit ViewPoints(float cell) : cell_(cell) {}

    /// Adds the trusted pixels that have a normal. Throws Error(ExitCode::input) if a point lies
    /// outside of the grid's range.
    void add(const PointView& view);

    /// Doubles the cells until the points and everything computed from them need at most half of
    /// `max_bytes`. Throws Error(ExitCode::memory) if no cell size is large enough.
    void fit(std::int64_t max_bytes);

    /// Drops the points that views look through, unless more than twice as many views see them.
    void drop_looked_through(const EvidenceSource& evidence);

    float cell() const { return cell_; }
    std::size_t dropped() const { return dropped_; }  // because views look through them
    OrientedPoints oriented() const;
    std::vector<Vec3f> colors() const;  // [0, 1]

private:
    struct Point {
        std::uint64_t key;
        Vec3f position, normal, color;  // means; the normal has any length
        float pixels;
    };

    std::uint64_t key(Vec3f position, Vec3f normal) const;
    /// Adds `points`, in any order, and merges points of the same key.
    void merge(std::vector<Point> points);

    float cell_;
    std::vector<Point> points_;  // by ascending keys
    std::size_t dropped_ = 0;
};

}  // namespace tvsgs
