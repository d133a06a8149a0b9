// Finds the views that show a face, with their quality and colour.
#pragma once

#include <vector>

#include "core/device/buffer.h"
#include "core/scene/mesh.h"
#include "core/scene/scene.h"

namespace tvsgs::texture {

struct Projection {
    // Pixels from the corner of the image; depth, <= 0: behind the camera.
    double u = 0, v = 0, z = 0;
};

struct PhotoView {
    Camera camera;
    const ImageU8* photo;
    const ImageU8* mask;     // null: everything counts
    Vec3f gain = {1, 1, 1};  // makes the photograph as bright as the others

    /// Transforms a world point to the camera frame.
    Vec3d in_camera(Vec3d point) const;
    Projection project_from_camera(Vec3d point) const;
    Projection project(Vec3d point) const { return project_from_camera(in_camera(point)); }
    /// Mean of the photograph over `footprint` pixels a side, times `gain`.
    Vec3f color(double u, double v, double footprint = 1) const;
};

/// The views that have a photograph.
std::vector<PhotoView> photo_views(const std::vector<View>& views, bool masks);

/// Occlusion of the mesh in one view.
struct SightMaps {
    ImageF depth;    // [H W 1] of the mesh's z-buffer, 0: none
    ImageF nearest;  // [H W 1] the least depth within 2 pixels, 0: none
};

/// The maps of all views, one view at a time. Keeps up to 512 MB of depth maps and renders the
/// others again.
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

/// A point is visible up to 2 pixels behind the z-buffer; `edge`: another surface nearby is more
/// than 4 pixels in front. `pixel`: length of a pixel along the surface (z / f over the cosine).
Sight sight_of(const PhotoView& view, const SightMaps& maps, const Projection& at, double pixel);

/// Area, normal and corners of a face.
struct FaceShape {
    Vec3d corners[3], centre, normal;  // normal: unit, 0 if there is no area
    double area;                       // world units squared

    FaceShape(const TriangleMesh& mesh, int face);
    /// Cosine between the normal and the direction to the camera.
    double cosine(const PhotoView& view) const;
};

/// A view that shows a face completely.
struct Candidate {
    int view;
    float quality;  // pixels of area times the cosine
    float pixel;    // world units per pixel of the photograph
    Vec3f color;    // mean, times the gain
};

inline constexpr std::size_t kMaxCandidates = 16;  // of a face; the best ones

/// Candidates of each face: face f has `all[begin[f]]` to `all[begin[f + 1]]`, by view.
struct Candidates {
    std::vector<std::size_t> begin;
    std::vector<Candidate> all;
    // [faces] world units per pixel where any part is visible; 0: none.
    std::vector<float> seen_pixel;

    int faces() const { return static_cast<int>(begin.size()) - 1; }
    Span<const Candidate> of(int face) const {
        return {all.data() + begin[face], begin[face + 1] - begin[face]};
    }
    /// Removes the candidates with stay [all] 0.
    void keep(const std::vector<char>& stay);
};

Candidates find_candidates(const TriangleMesh& mesh,
                           const std::vector<PhotoView>& views,
                           Sights& sights);

}  // namespace tvsgs::texture
