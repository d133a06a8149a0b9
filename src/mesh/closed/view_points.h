// The surface that depth maps show, as oriented points.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/camera.h"
#include "mesh/closed/poisson.h"
#include "mesh/mend/mesh_evidence.h"

namespace tvsgs {

/// A depth map on the host, with what mesh/fuse/pixel_trust.h says of it.
struct PointView {
    Camera camera;
    std::vector<float> depth;   // [H W] z-depth; 0: nothing there
    std::vector<Vec3f> color;   // [H W]
    std::vector<float> weight;  // [H W]
    std::vector<Vec3f> normal;  // [H W] camera frame, facing the camera, of any length
};

/// Points of many depth maps, one for each cell of a grid and each octant that normals point into:
/// the means of the pixels there. In the order of the cells.
class ViewPoints {
public:
    /// `cell`: its side, world units, > 0.
    explicit ViewPoints(float cell) : cell_(cell) {}

    /// Adds the trusted pixels that have a normal. Throws Error(ExitCode::input) for depths too far
    /// out for the grid.
    void add(const PointView& view);

    /// Doubles the cells until the points, and what is made of them, take half of that at most.
    /// Throws Error(ExitCode::memory) where that cannot be.
    void fit(std::int64_t max_bytes);

    /// Leaves out what views look through, unless more than twice as many see it.
    void drop_looked_through(const EvidenceSource& evidence);

    float cell() const { return cell_; }
    std::size_t dropped() const { return dropped_; }  // as views look through them
    OrientedPoints oriented() const;
    std::vector<Vec3f> colors() const;  // [0, 1]

private:
    struct Point {
        std::uint64_t key;
        Vec3f position, normal, color;  // means; the normal of any length
        float pixels;
    };

    std::uint64_t key(Vec3f position, Vec3f normal) const;
    /// Those of the same key become one; `points` are not in order yet.
    void merge(std::vector<Point> points);

    float cell_;
    std::vector<Point> points_;  // by ascending keys
    std::size_t dropped_ = 0;
};

}  // namespace tvsgs
