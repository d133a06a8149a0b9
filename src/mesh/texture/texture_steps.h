// The steps of make_texture(), in order: views, exposures, labels, charts, seams, pixels.
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

/// Sets the views' gains by least squares of the median log ratios of their colours on common
/// faces, per channel, with a mean gain of 1; multiplies the candidates' colours by them.
void level_exposures(Candidates& candidates, std::vector<PhotoView>& views);

/// Drops a view of a face, of at least four, if its colour differs from the others': an object that
/// is not in the mesh occludes the face.
void drop_outliers(Candidates& candidates);

/// An edge with two faces; the lower vertex comes first.
struct SharedEdge {
    int faces[2];
    int vertices[2];
};

/// All of them, by vertices; without boundary edges and edges of more than two faces.
std::vector<SharedEdge> shared_edges(const TriangleMesh& mesh);

/// Inputs of the steps below.
struct Subject {
    const TriangleMesh& mesh;
    const std::vector<PhotoView>& views;
    const Candidates& candidates;
    const std::vector<SharedEdge>& edges;
};

/// The view of each face; -1 if none shows it completely. A view costs the face's area, in pixels,
/// times the relative loss of quality against the best view; an edge between two views its length.
/// Changes face by face until none improves. Then parts of less than 50 pixels take the view of a
/// neighbour that shows them.
std::vector<int> choose_views(const Subject& in);

/// Connected faces of one view: the part of each face, -1 for faces without a view. Parts are
/// numbered by their first faces. `count`: number of parts.
std::vector<int> connected_parts(const std::vector<int>& views,
                                 const std::vector<SharedEdge>& edges,
                                 int& count);

inline constexpr int kBorder_px = 2;  // around charts and tiles: 4 pixels lie between two of them

/// A rectangle of texels.
struct Rect {
    int x = 0, y = 0, width = 0, height = 0;
};

/// Connected faces projected into one view: the texel (i, j) of its rectangle shows the pixel
/// ((left + i + 0.5) / scale, (top + j + 0.5) / scale) of the photograph.
struct Chart {
    int view = 0;
    std::vector<int> faces;
    double bounds[4];  // of the projections: least u and v, greatest u and v, pixels
    int left = 0, top = 0;
    Rect rect;
};

/// A single face, unfolded; corners in texels from the corner of its rectangle.
struct Tile {
    int face = 0;
    bool seen = false;  // views show parts of it; else it gets its vertex colours
    double length = 0;  // of its longest edge, in pixels
    double finest = 0;  // world units per pixel of the best view; 0: none
    int first = 0;      // the corner where its longest edge starts
    Vec2<double> corners[3];
    Rect rect;
    int same_as = -1;  // index of a tile of the same colour to use instead; -1: none
};

struct Atlas {
    int width = 0, height = 0;
    double scale = 1;  // texels per pixel
    std::vector<Chart> charts;
    std::vector<Tile> tiles;
};

/// Packs charts of faces with a view and tiles of the others into shelves, the highest first.
/// Shrinks them in steps of 5 % until they fit into `max_side`.
Atlas lay_out(const Subject& in,
              const std::vector<int>& view_of_face,
              int max_side,
              bool fixed_side);

/// A correction of one chart: values at every `spacing` pixels of the photograph, linear between
/// them.
struct Correction {
    double left = 0, top = 0, spacing = 1;  // pixels
    int columns = 0, rows = 0;
    std::vector<Vec3f> values;  // [rows columns]

    Vec3f at(double u, double v) const;
};

/// One correction per chart, by least squares of: the steps along all edges between charts, the
/// difference of each face from the mean of all views, and the differences of neighbouring values.
/// [docs/method/texture.md#seams] `compared`: number of sample points on edges.
std::vector<Correction> level_seams(const Subject& in,
                                    const std::vector<Chart>& charts,
                                    int& compared);

/// Texels from the corner of the chart's rectangle.
Vec2<double> place_in(const Chart& chart, double scale, const Projection& p);

/// Draws charts with their corrections, and tiles, on a background of the mean colour.
ImageU8 fill_texture(const Subject& in,
                     const Atlas& atlas,
                     const std::vector<Correction>& corrections,
                     Sights& sights);

}  // namespace tvsgs::texture
