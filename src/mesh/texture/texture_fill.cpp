#include <algorithm>
#include <cmath>

#include "core/device/parallel.h"
#include "mesh/texture/texture_steps.h"

namespace tvsgs::texture {
namespace {

constexpr double kCovered_px = 0.75;     // a texel counts as covered up to so far beside a face
constexpr double kMinTileCosine = 0.05;  // of views that show parts of a face

constexpr Vec3f kGrey{0.5f, 0.5f, 0.5f};  // of faces without a colour

Vec3f mean_color(const Candidates& candidates) {
    Vec3d sum{};
    for (const Candidate& c : candidates.all) sum += vec_cast<double>(c.color);
    return candidates.all.empty()
               ? kGrey
               : vec_cast<float>(sum / static_cast<double>(candidates.all.size()));
}

void set_texel(ImageU8& image, int x, int y, Vec3f color) {
    for (int c = 0; c < 3; ++c) {
        const float value = color[c] > 0 ? std::min(color[c], 1.0f) : 0;  // NaN: 0
        image.at(x, y, c) = static_cast<std::uint8_t>(value * 255 + 0.5f);
    }
}

Vec3d corner_of(const TriangleMesh& mesh, int face, int c) {
    return vec_cast<double>(mesh.vertices[mesh.faces[face][c]]);
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

    /// Gives texels beside known ones the mean colour of the known ones, `times` times.
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

/// Calls set(x, y, weights, outside) for the texels that a triangle covers or nearly covers.
/// `weights`: of the corners, at the texel's centre or at the nearest point of the triangle;
/// `outside`: distance of the centre from the triangle, in weights.
template <class Set>
void for_covered(const Vec2<double> (&p)[3], Rect rect, const Set& set) {
    const auto [low_x, high_x] = std::minmax({p[0].x, p[1].x, p[2].x});
    const auto [low_y, high_y] = std::minmax({p[0].y, p[1].y, p[2].y});
    const double turn =
        (p[1].x - p[0].x) * (p[2].y - p[0].y) - (p[1].y - p[0].y) * (p[2].x - p[0].x);
    const double sign = turn < 0 ? -1 : 1;
    // Texel centres up to one texel beside the triangle.
    const int x0 = std::max(0, static_cast<int>(std::ceil(low_x - 1.5))),
              x1 = std::min(rect.width - 1, static_cast<int>(std::floor(high_x + 0.5))),
              y0 = std::max(0, static_cast<int>(std::ceil(low_y - 1.5))),
              y1 = std::min(rect.height - 1, static_cast<int>(std::floor(high_y + 0.5)));
    Vec2<double> sides[3];  // opposite of each corner
    double least[3];
    for (int c = 0; c < 3; ++c) {
        sides[c] = sign * (p[(c + 2) % 3] - p[(c + 1) % 3]);
        least[c] = -kCovered_px * std::sqrt(dot(sides[c], sides[c]));
    }
    for (int y = y0; y <= y1; ++y)
        for (int x = x0; x <= x1; ++x) {
            double weights[3], sum = 0, outside = 0;
            bool covered = true;
            for (int c = 0; c < 3; ++c) {
                const Vec2<double> a = p[(c + 1) % 3];
                const double cross = sides[c].x * (y + 0.5 - a.y) - sides[c].y * (x + 0.5 - a.x);
                covered = covered && cross >= least[c];
                outside = std::max(outside, -cross);
                sum += weights[c] = std::max(cross, 0.0);
            }
            if (!covered) continue;
            for (double& w : weights) w = sum > 0 ? w / sum : 1.0 / 3;
            set(x, y, weights, turn != 0 ? outside / std::abs(turn) : 1e30);
        }
}

void fill_chart(const Subject& in,
                const Chart& chart,
                const Correction& correction,
                double scale,
                ImageU8& image) {
    const TriangleMesh& mesh = in.mesh;
    const PhotoView& view = in.views[chart.view];
    Patch patch(chart.rect);
    // 1. The face of each texel; a face that contains its centre wins.
    struct Cover {
        int face = -1;
        float outside = INFINITY, weights[3];
    };
    std::vector<Cover> covers(patch.known.size());
    for (const int f : chart.faces) {
        Vec2<double> corners[3];
        for (int c = 0; c < 3; ++c)
            corners[c] = place_in(chart, scale, view.project(corner_of(mesh, f, c)));
        for_covered(corners, chart.rect,
                    [&](int x, int y, const double(&weights)[3], double outside) {
                        Cover& cover = covers[patch.index(x, y)];
                        if (!(outside < double{cover.outside})) return;
                        cover.face = f, cover.outside = static_cast<float>(outside);
                        for (int c = 0; c < 3; ++c)
                            cover.weights[c] = static_cast<float>(weights[c]);
                    });
    }
    // 2. Samples the photograph at surface points, because texture mapping is linear within a face
    // and projection is not.
    for (std::size_t i = 0; i < covers.size(); ++i) {
        if (covers[i].face < 0) continue;
        Vec3d point;
        for (int c = 0; c < 3; ++c)
            point += double{covers[i].weights[c]} * corner_of(mesh, covers[i].face, c);
        const Projection at = view.project(point);
        patch.known[i] = 1;
        patch.colors[i] = view.color(at.u, at.v, 1 / scale) + correction.at(at.u, at.v);
    }
    patch.dilate(kBorder_px);
    patch.put_into(image, chart.rect);
}

/// Positions of a tile's texels on its face.
struct TilePlaces {
    const Tile& tile;
    Vec2<double> ab, ac;
    double turn, texel = 0;  // world units

    TilePlaces(const FaceShape& face, const Tile& t)
        : tile(t), ab(t.corners[1] - t.corners[0]), ac(t.corners[2] - t.corners[0]) {
        turn = ab.x * ac.y - ab.y * ac.x;
        for (int c = 0; c < 3; ++c)
            texel = std::max(texel, norm(face.corners[(c + 1) % 3] - face.corners[c]));
        texel /= std::max(1.0, static_cast<double>(t.rect.width) - 5);
    }
    /// Barycentric weights; outside of the face they leave [0, 1].
    Vec3d weights(int x, int y) const {
        if (turn == 0) return {1.0 / 3, 1.0 / 3, 1.0 / 3};
        const Vec2<double> d = Vec2<double>{x + 0.5, y + 0.5} - tile.corners[0];
        const double b = (d.x * ac.y - d.y * ac.x) / turn, c = (ab.x * d.y - ab.y * d.x) / turn;
        return {1 - b - c, b, c};
    }
    Vec3d point(const FaceShape& face, int x, int y) const {
        const Vec3d w = weights(x, y);
        Vec3d sum;
        double total = 0;
        for (int c = 0; c < 3; ++c)
            sum += std::max(w[c], 0.0) * face.corners[c], total += std::max(w[c], 0.0);
        return sum / total;
    }
};

/// Weighted colours of one tile's texels; near and frontal views have the largest weights.
struct TileColors {
    const Tile* tile;
    std::vector<Vec3f> sums;  // [height width]
    std::vector<float> weights;

    explicit TileColors(const Tile& t)
        : tile(&t), sums(static_cast<std::size_t>(t.rect.width) * t.rect.height) {
        weights.resize(sums.size());
    }
    void add(const TriangleMesh& mesh, const PhotoView& view, const SightMaps& maps) {
        const FaceShape face(mesh, tile->face);
        const double cosine = face.cosine(view);
        if (!(cosine > kMinTileCosine)) return;
        const TilePlaces places(face, *tile);
        for (int y = 0, i = 0; y < tile->rect.height; ++y)
            for (int x = 0; x < tile->rect.width; ++x, ++i) {
                const Projection p = view.project(places.point(face, x, y));
                const double pixel = p.z / view.camera.fx_px;
                const Sight sight = sight_of(view, maps, p, pixel / std::max(cosine, 0.1));
                if (sight == Sight::none) continue;
                // In units of the finest pixel, so that its square fits into a float.
                const double share = tile->finest / pixel;
                const auto weight = static_cast<float>(std::pow(cosine * share * share, 2) *
                                                       (sight == Sight::edge ? 1e-3 : 1));
                sums[i] += weight * view.color(p.u, p.v, std::max(1.0, places.texel / pixel));
                weights[i] += weight;
            }
    }
};

/// Vertex colours of the face, extrapolated outside of it: linear, hence exact between texels.
Vec3f vertex_color(const TriangleMesh& mesh, int face, Vec3d weights) {
    if (mesh.colors.empty()) return kGrey;
    Vec3f color;
    for (int c = 0; c < 3; ++c)
        color += static_cast<float>(weights[c]) * mesh.colors[mesh.faces[face][c]];
    return color;
}

void fill_tiles(const Subject& in, const std::vector<Tile>& tiles, Sights& sights, ImageU8& image) {
    const TriangleMesh& mesh = in.mesh;
    std::vector<TileColors> seen;
    for (const Tile& tile : tiles)
        if (tile.seen) seen.emplace_back(tile);
    for (std::size_t v = 0; v < in.views.size() && !seen.empty(); ++v) {
        const SightMaps maps = sights.of(static_cast<int>(v));
        parallel_for_heavy(Cpu{}, static_cast<int>(seen.size()),
                           [&](int i) { seen[i].add(mesh, in.views[v], maps); });
    }
    const auto put = [&](const Tile& tile, const TileColors* colors) {
        const TilePlaces places(FaceShape(mesh, tile.face), tile);
        for (int y = 0, i = 0; y < tile.rect.height; ++y)
            for (int x = 0; x < tile.rect.width; ++x, ++i)
                set_texel(image, tile.rect.x + x, tile.rect.y + y,
                          colors && colors->weights[i] > 0
                              ? colors->sums[i] / colors->weights[i]
                              : vertex_color(mesh, tile.face, places.weights(x, y)));
    };
    parallel_for(Cpu{}, static_cast<int>(tiles.size()), [&](int i) {
        if (!tiles[i].seen && tiles[i].same_as < 0) put(tiles[i], nullptr);
    });
    parallel_for(Cpu{}, static_cast<int>(seen.size()),
                 [&](int i) { put(*seen[i].tile, &seen[i]); });
}

}  // namespace

Vec2<double> place_in(const Chart& chart, double scale, const Projection& p) {
    return {p.u * scale - chart.left, p.v * scale - chart.top};
}

ImageU8 fill_texture(const Subject& in,
                     const Atlas& atlas,
                     const std::vector<Correction>& corrections,
                     Sights& sights) {
    ImageU8 image(atlas.width, atlas.height, 3);
    const Vec3f ground = mean_color(in.candidates);
    parallel_for_heavy(Cpu{}, atlas.height, [&](int y) {
        for (int x = 0; x < atlas.width; ++x) set_texel(image, x, y, ground);
    });
    parallel_for_heavy(Cpu{}, static_cast<int>(atlas.charts.size()), [&](int k) {
        fill_chart(in, atlas.charts[k], corrections[k], atlas.scale, image);
    });
    fill_tiles(in, atlas.tiles, sights, image);
    return image;
}

}  // namespace tvsgs::texture
