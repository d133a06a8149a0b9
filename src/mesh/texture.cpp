#include "mesh/texture.h"

#include <algorithm>
#include <cmath>

#include "core/parallel.h"
#include "mesh/texture_charts.h"
#include "mesh/texture_level.h"

namespace tvsgs {
namespace texture {
namespace {

constexpr double kCovered_px = 0.75;  // a texel counts as covered from that far beside a face
constexpr Vec3f kGrey{0.5f, 0.5f, 0.5f};
constexpr double kLeastTileCosine = 0.05;  // of views that show parts of a face

void set_texel(ImageU8& image, int x, int y, Vec3f color) {
    for (int c = 0; c < 3; ++c) {
        const float value = color[c] > 0 ? std::min(color[c], 1.0f) : 0;  // NaN: 0
        image.at(x, y, c) = static_cast<std::uint8_t>(value * 255 + 0.5f);
    }
}

/// The texels of one rectangle that have a colour.
struct Patch {
    int width, height;
    std::vector<char> known;
    std::vector<Vec3f> colors;

    explicit Patch(Rect rect)
        : width(rect.width),
          height(rect.height),
          known(static_cast<std::size_t>(rect.width) * rect.height, 0),
          colors(known.size()) {}
    std::size_t index(int x, int y) const { return static_cast<std::size_t>(y) * width + x; }

    /// Texels beside known ones take the mean of these, `times` over.
    void dilate(int times) {
        for (; times > 0; --times) {
            const std::vector<char> before = known;
            for (int y = 0; y < height; ++y)
                for (int x = 0; x < width; ++x) {
                    if (before[index(x, y)]) continue;
                    Vec3f sum;
                    int count = 0;
                    for (int j = std::max(0, y - 1); j <= std::min(height - 1, y + 1); ++j)
                        for (int i = std::max(0, x - 1); i <= std::min(width - 1, x + 1); ++i)
                            if (before[index(i, j)]) sum += colors[index(i, j)], ++count;
                    if (count == 0) continue;
                    known[index(x, y)] = 1;
                    colors[index(x, y)] = sum / static_cast<float>(count);
                }
        }
    }
    void put_into(ImageU8& image, Rect rect) const {
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x)
                if (known[index(x, y)])
                    set_texel(image, rect.x + x, rect.y + y, colors[index(x, y)]);
    }
};

/// Calls set(x, y, weights, outside) for the texels of a patch that a triangle covers, or nearly
/// so: the weights of its corners at the texel's middle, or at the place of the triangle next to
/// it, and how far outside, in weights, that middle is.
template <class Set>
void for_covered(const Vec2<double> (&p)[3], int width, int height, const Set& set) {
    double low[2] = {1e30, 1e30}, high[2] = {-1e30, -1e30};
    for (const auto& corner : p) {
        low[0] = std::min(low[0], corner.x), high[0] = std::max(high[0], corner.x);
        low[1] = std::min(low[1], corner.y), high[1] = std::max(high[1], corner.y);
    }
    const double turn =
        (p[1].x - p[0].x) * (p[2].y - p[0].y) - (p[1].y - p[0].y) * (p[2].x - p[0].x);
    const double sign = turn < 0 ? -1 : 1;
    const int x0 = std::max(0, static_cast<int>(std::floor(low[0] - 1))),
              x1 = std::min(width - 1, static_cast<int>(std::ceil(high[0] + 1))),
              y0 = std::max(0, static_cast<int>(std::floor(low[1] - 1))),
              y1 = std::min(height - 1, static_cast<int>(std::ceil(high[1] + 1)));
    for (int y = y0; y <= y1; ++y)
        for (int x = x0; x <= x1; ++x) {
            double weights[3], sum = 0, outside = 0;
            bool covered = true;
            for (int c = 0; c < 3 && covered; ++c) {
                const Vec2<double> a = p[(c + 1) % 3], b = p[(c + 2) % 3];
                const double cross =
                    sign * ((b.x - a.x) * (y + 0.5 - a.y) - (b.y - a.y) * (x + 0.5 - a.x));
                covered = cross >= -kCovered_px * std::hypot(b.x - a.x, b.y - a.y);
                outside = std::max(outside, -cross);
                sum += weights[c] = std::max(cross, 0.0);
            }
            if (!covered) continue;
            for (double& w : weights) w = sum > 0 ? w / sum : 1.0 / 3;
            set(x, y, weights, turn != 0 ? outside / std::abs(turn) : 1e30);
        }
}

Vec2<double> place_in(const Chart& chart, double scale, const Projection& p) {
    return {p.u * scale - chart.left, p.v * scale - chart.top};
}

void fill_chart(const TriangleMesh& mesh,
                const PhotoView& view,
                const Chart& chart,
                const Correction& correction,
                double scale,
                ImageU8& image) {
    Patch patch(chart.rect);
    // By points of the surface: within a face the texture is linear, a photograph is not.
    std::vector<double> outside(patch.known.size(), INFINITY);
    for (const int f : chart.faces) {
        const FaceShape face(mesh, f);
        Vec2<double> corners[3];
        for (int c = 0; c < 3; ++c)
            corners[c] = place_in(chart, scale, view.project(face.corners[c]));
        for_covered(corners, patch.width, patch.height,
                    [&](int x, int y, const double(&weights)[3], double beside) {
                        const std::size_t i = patch.index(x, y);
                        if (!(beside < outside[i])) return;  // a face that it lies in is the first
                        outside[i] = beside, patch.known[i] = 1;
                        Vec3d point;
                        for (int c = 0; c < 3; ++c) point += weights[c] * face.corners[c];
                        const Projection at = view.project(point);
                        patch.colors[i] =
                            view.color(at.u, at.v, 1 / scale) + correction.at(at.u, at.v);
                    });
    }
    patch.dilate(kBorder_px);
    patch.put_into(image, chart.rect);
}

/// What the views that see the point say of it, the near and frontal ones most; else `otherwise`.
Vec3f seen_color(const std::vector<PhotoView>& views,
                 const FaceShape& face,
                 Vec3d point,
                 double texel,
                 Vec3f otherwise) {
    Vec3d sum;
    double weights = 0;
    for (const PhotoView& view : views) {
        const double cosine = face.cosine(view);
        if (!(cosine > kLeastTileCosine)) continue;
        const Projection p = view.project(point);
        const double pixel = p.z / view.camera.fx_px;
        const Sight sight = sight_of(view, p, pixel / std::max(cosine, 0.1));
        if (sight == Sight::none) continue;
        double weight = cosine / (pixel * pixel);
        weight *= weight * (sight == Sight::edge ? 1e-3 : 1);
        sum += weight * vec_cast<double>(view.color(p.u, p.v, std::max(1.0, texel / pixel)));
        weights += weight;
    }
    return weights > 0 ? vec_cast<float>(sum / weights) : otherwise;
}

void fill_tile(const TriangleMesh& mesh,
               const std::vector<PhotoView>& views,
               const Tile& tile,
               ImageU8& image) {
    const FaceShape face(mesh, tile.face);
    const Vec2<double>(&p)[3] = tile.corners;
    const Vec2<double> ab = p[1] - p[0], ac = p[2] - p[0];
    const double turn = ab.x * ac.y - ab.y * ac.x;
    const double longest =
        std::max({norm(face.corners[1] - face.corners[0]), norm(face.corners[2] - face.corners[1]),
                  norm(face.corners[0] - face.corners[2])});
    const double texel = longest / std::max(1.0, static_cast<double>(tile.rect.width) - 5);
    for (int y = 0; y < tile.rect.height; ++y)
        for (int x = 0; x < tile.rect.width; ++x) {
            const Vec2<double> d = Vec2<double>{x + 0.5, y + 0.5} - p[0];
            double w[3] = {1.0 / 3, 1.0 / 3, 1.0 / 3};
            if (turn != 0) {
                w[1] = (d.x * ac.y - d.y * ac.x) / turn, w[2] = (ab.x * d.y - ab.y * d.x) / turn;
                w[0] = 1 - w[1] - w[2];
            }
            Vec3f color = kGrey;
            if (!mesh.colors
                     .empty()) {  // also beside the face: linear in it, so exact between texels
                color = {};
                for (int c = 0; c < 3; ++c)
                    color += static_cast<float>(w[c]) * mesh.colors[mesh.faces[tile.face][c]];
            }
            if (tile.seen) {
                double inside[3], sum = 0;
                for (int c = 0; c < 3; ++c) sum += inside[c] = std::max(w[c], 0.0);
                Vec3d point;
                for (int c = 0; c < 3; ++c) point += inside[c] / sum * face.corners[c];
                color = seen_color(views, face, point, texel, color);
            }
            set_texel(image, tile.rect.x + x, tile.rect.y + y, color);
        }
}

/// Where the corners of all faces lie.
void set_places(const TriangleMesh& mesh,
                const std::vector<PhotoView>& views,
                const Atlas& atlas,
                MeshTexture& out) {
    const auto add = [&](Rect rect, Vec2<double> at) {
        out.places.push_back({static_cast<float>((rect.x + at.x) / atlas.width),
                              static_cast<float>((rect.y + at.y) / atlas.height)});
        return static_cast<int>(out.places.size()) - 1;
    };
    out.faces.assign(mesh.faces.size(), {});
    std::vector<int> place(mesh.vertices.size(), -1), last_chart(mesh.vertices.size(), -1);
    for (std::size_t k = 0; k < atlas.charts.size(); ++k) {
        const Chart& chart = atlas.charts[k];
        for (const int f : chart.faces)
            for (int c = 0; c < 3; ++c) {
                const int vertex = mesh.faces[f][c];
                if (last_chart[vertex] != static_cast<int>(k)) {
                    last_chart[vertex] = static_cast<int>(k);
                    const Projection p =
                        views[chart.view].project(vec_cast<double>(mesh.vertices[vertex]));
                    place[vertex] = add(chart.rect, place_in(chart, atlas.scale, p));
                }
                out.faces[f][c] = place[vertex];
            }
    }
    for (const Tile& tile : atlas.tiles) {
        const Tile& shown = tile.same_as < 0 ? tile : atlas.tiles[tile.same_as];
        for (int c = 0; c < 3; ++c) out.faces[tile.face][c] = add(shown.rect, shown.corners[c]);
    }
}

Vec3f mean_color(const Candidates& candidates) {
    Vec3d sum{};
    for (const Candidate& c : candidates.all) sum += vec_cast<double>(c.color);
    return candidates.all.empty()
               ? kGrey
               : vec_cast<float>(sum / static_cast<double>(candidates.all.size()));
}

}  // namespace
}  // namespace texture

MeshTexture make_texture(const TriangleMesh& mesh,
                         const std::vector<View>& views,
                         const TextureOptions& options,
                         TextureReport* report) {
    using namespace texture;
    MeshTexture out;
    if (mesh.faces.empty()) return out;
    std::vector<PhotoView> photos = photo_views(mesh, views, options.masks);
    Candidates candidates = find_candidates(mesh, photos);
    level_exposures(candidates, photos);
    drop_outliers(candidates);
    const std::vector<SharedEdge> edges = shared_edges(mesh);
    const std::vector<int> view_of_face = choose_views(mesh, candidates, edges);
    const Atlas atlas = lay_out(mesh, photos, candidates, view_of_face, edges, options.max_side,
                                options.fixed_side);
    int compared = 0;
    const std::vector<Correction> corrections =
        level_seams(mesh, photos, atlas.charts, edges, compared);

    out.image = ImageU8(atlas.width, atlas.height, 3);
    const Vec3f mean = mean_color(candidates);  // between charts, for smaller copies of the texture
    parallel_for_heavy(Cpu{}, atlas.height, [&](int y) {
        for (int x = 0; x < atlas.width; ++x) set_texel(out.image, x, y, mean);
    });
    parallel_for_heavy(Cpu{}, static_cast<int>(atlas.charts.size()), [&](int k) {
        const Chart& chart = atlas.charts[k];
        fill_chart(mesh, photos[chart.view], chart, corrections[k], atlas.scale, out.image);
    });
    parallel_for(Cpu{}, static_cast<int>(atlas.tiles.size()), [&](int i) {
        if (atlas.tiles[i].same_as < 0) fill_tile(mesh, photos, atlas.tiles[i], out.image);
    });
    set_places(mesh, photos, atlas, out);

    if (report) {
        *report = {};
        std::vector<char> used(photos.size(), 0);
        for (const Chart& chart : atlas.charts) used[chart.view] = 1;
        report->views_used = static_cast<int>(std::count(used.begin(), used.end(), 1));
        report->charts = static_cast<int>(atlas.charts.size());
        report->tiles = static_cast<int>(atlas.tiles.size());
        for (const Tile& tile : atlas.tiles) report->unseen += !tile.seen;
        report->seams = compared, report->scale = atlas.scale;
    }
    return out;
}

}  // namespace tvsgs
