// Which views show a face, how well, and in what colour.
#pragma once

#include <vector>

#include "core/device/buffer.h"
#include "core/scene/mesh.h"
#include "core/scene/scene.h"

namespace tvsgs::texture {

struct Projection {
    double u = 0, v = 0, z = 0;  // pixels from the corner of the image; depth, not above 0: behind
};

struct PhotoView {
    Camera camera;
    const ImageU8* photo;
    const ImageU8* mask;     // null: all of it counts
    Vec3f gain = {1, 1, 1};  // what makes the photograph as bright as the others

    /// Of points in the world, or already in the frame of the camera.
    Vec3d in_camera(Vec3d point) const;
    Projection project_from_camera(Vec3d point) const;
    Projection project(Vec3d point) const { return project_from_camera(in_camera(point)); }
    /// Of the photograph, at most `footprint` pixels a side, times `gain`.
    Vec3f color(double u, double v, double footprint = 1) const;
};

/// Those of `views` that have a photograph.
std::vector<PhotoView> photo_views(const std::vector<View>& views, bool masks);

/// What the mesh hides in one view.
struct SightMaps {
    ImageF depth;    // [H W 1] of the mesh's own z-buffer, 0: nothing there
    ImageF nearest;  // [H W 1] the least depth up to 2 pixels around, 0: nothing there
};

/// The maps of all views, one at a time in memory; depth is kept for a second look as far as 512 MB
/// allow, else drawn again.
class Sights {
public:
    Sights(const TriangleMesh& mesh, const std::vector<PhotoView>& views)
        : mesh_(mesh), views_(views), kept_(views.size()) {}
    SightMaps of(int view);

private:
    const TriangleMesh& mesh_;
    const std::vector<PhotoView>& views_;
    std::vector<ImageF> kept_;
    std::size_t kept_pixels_ = 0;
};

/// How a view shows a point of the surface.
enum class Sight { none, edge, clear };

/// `pixel`: of the surface there, as wide as it is seen (z / f over the cosine). Nearer than
/// 2 pixels behind what the z-buffer has, a point is seen; `edge`: with something in front of it
/// close by, in 4 pixels.
Sight sight_of(const PhotoView& view, const SightMaps& maps, const Projection& at, double pixel);

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

inline constexpr std::size_t kMostCandidates = 16;  // of a face: the best

/// Those of each face: of face f `all[begin[f]]` to `all[begin[f + 1]]`, by view.
struct Candidates {
    std::vector<std::size_t> begin;
    std::vector<Candidate> all;
    std::vector<float> seen_pixel;  // [faces] world units per pixel where any part is seen; 0: none

    int faces() const { return static_cast<int>(begin.size()) - 1; }
    Span<const Candidate> of(int face) const {
        return {all.data() + begin[face], begin[face + 1] - begin[face]};
    }
    /// Leaves those out that `stay` [all] denies.
    void keep(const std::vector<char>& stay);
};

Candidates find_candidates(const TriangleMesh& mesh,
                           const std::vector<PhotoView>& views,
                           Sights& sights);

}  // namespace tvsgs::texture
