// Which views show a face, how well, and in what colour.
#pragma once

#include <vector>

#include "core/buffer.h"
#include "core/mesh.h"
#include "core/scene.h"

namespace tvsgs::texture {

struct Projection {
    double u = 0, v = 0, z = 0;  // pixels from the corner of the image; depth, not above 0: behind
};

/// A photograph with what the mesh hides in it.
struct PhotoView {
    Camera camera;
    const ImageU8* photo;
    const ImageU8* mask;  // null: all of it counts
    ImageF depth;         // [H W 1] of the mesh's own z-buffer, 0: nothing there
    ImageF nearest;       // [H W 1] the least depth up to kEdge pixels around, 0: nothing there
    Vec3f gain{1, 1, 1};  // what makes the photograph as bright as the others

    static constexpr int kEdge = 2;

    Projection project(Vec3d point) const;
    /// Of the photograph, at most `footprint` pixels a side, times `gain`.
    Vec3f color(double u, double v, double footprint = 1) const;
};

/// Those of `views` that have a photograph.
std::vector<PhotoView> photo_views(const TriangleMesh& mesh,
                                   const std::vector<View>& views,
                                   bool masks);

/// How a view shows a point of the surface.
enum class Sight { none, edge, clear };

/// `pixel`: of the surface there, as wide as it is seen (z / f over the cosine). Nearer than
/// 2 pixels behind what the z-buffer has, a point is seen; `edge`: with something in front of it
/// close by, in 4 pixels.
Sight sight_of(const PhotoView& view, const Projection& at, double pixel);

/// The area, normal and places of a face.
struct FaceShape {
    Vec3d corners[3], centre, normal;  // normal: unit, 0 where there is no area
    double area;                       // world units

    FaceShape(const TriangleMesh& mesh, int face);
    /// Cosine between its normal and the way to the camera.
    double cosine(const PhotoView& view) const;
};

/// A view that shows all of a face.
struct Candidate {
    int view;
    float quality;  // pixels of area times the cosine
    float pixel;    // world units per pixel of the photograph
    Vec3f color;    // mean, times the gain
};

/// Those of each face: of face f `all[begin[f]]` to `all[begin[f + 1]]`, by view.
struct Candidates {
    std::vector<std::size_t> begin;
    std::vector<Candidate> all;
    std::vector<float> seen_pixel;  // [faces] world units per pixel where any part is seen; 0: none

    Span<const Candidate> of(int face) const {
        return {all.data() + begin[face], begin[face + 1] - begin[face]};
    }
};

Candidates find_candidates(const TriangleMesh& mesh, const std::vector<PhotoView>& views);

/// Sets the views' gains by what they say of common faces, and multiplies the candidates' colours
/// by them. Per channel, the least squares of the medians of logarithms over each pair of views,
/// with a mean of 1.
void level_exposures(Candidates& candidates, std::vector<PhotoView>& views);

/// Drops views that show another colour of a face than the others do, of four at least: something
/// that is not in the mesh stands before it.
void drop_outliers(Candidates& candidates);

}  // namespace tvsgs::texture
