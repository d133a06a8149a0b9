#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <tuple>

#include "core/error.h"
#include "mesh/texture/texture_steps.h"

namespace tvsgs::texture {
namespace {

constexpr int kMinSide = 256;
constexpr double kStep = 0.95, kMinScale = 0.01;
constexpr double kUnseenLength = 2;  // texels of the longest edge of an unseen face
constexpr double kMaxLength = 1024;  // of a partly visible face
// Of the texture; unseen faces are flat if they would take more.
constexpr double kShareOfUnseen = 0.25;
constexpr int kColorSteps = 32;  // per channel, of flat tiles

std::vector<Chart> charts_of(const Subject& in, const std::vector<int>& view_of_face) {
    int count = 0;
    const std::vector<int> part = connected_parts(view_of_face, in.edges, count);
    std::vector<Chart> charts(count);
    for (std::size_t f = 0; f < part.size(); ++f) {
        if (part[f] < 0) continue;
        Chart& chart = charts[part[f]];
        if (chart.faces.empty()) {
            chart.view = view_of_face[f];
            for (int i = 0; i < 4; ++i) chart.bounds[i] = i < 2 ? 1e30 : -1e30;
        }
        chart.faces.push_back(static_cast<int>(f));
        for (int c = 0; c < 3; ++c) {
            const Projection p = in.views[chart.view].project(
                vec_cast<double>(in.mesh.vertices[in.mesh.faces[f][c]]));
            const double at[2] = {p.u, p.v};
            for (int i = 0; i < 2; ++i) {
                chart.bounds[i] = std::min(chart.bounds[i], at[i]);
                chart.bounds[2 + i] = std::max(chart.bounds[2 + i], at[i]);
            }
        }
    }
    return charts;
}

Tile tile_of(const TriangleMesh& mesh, int face, float pixel) {
    Tile tile;
    tile.face = face, tile.seen = pixel > 0, tile.finest = double{pixel};
    const FaceShape shape(mesh, face);
    double longest = -1;
    for (int c = 0; c < 3; ++c)
        if (const double l = norm(shape.corners[(c + 1) % 3] - shape.corners[c]); l > longest)
            longest = l, tile.first = c;
    tile.length = tile.seen ? std::min(longest / pixel, kMaxLength) : kUnseenLength;
    return tile;
}

void place_tile(const TriangleMesh& mesh, double scale, bool flat, Tile& tile) {
    const FaceShape shape(mesh, tile.face);
    const auto corner = [&](int i) { return shape.corners[(tile.first + i) % 3]; };
    const Vec3d base = corner(1) - corner(0), side = corner(2) - corner(0);
    const double longest = norm(base);
    const double length = tile.seen ? tile.length * scale : flat ? 0 : tile.length;
    const double per_unit = longest > 0 ? length / longest : 0;
    const double along = longest > 0 ? dot(side, base) / longest * per_unit : 0,
                 across = longest > 0 ? norm(cross(base, side)) / longest * per_unit : 0;
    const Vec2<double> places[3] = {{0, 0}, {length, 0}, {along, across}};
    const int border = tile.seen ? kBorder_px : 1;
    for (int i = 0; i < 3; ++i)
        tile.corners[(tile.first + i) % 3] = places[i] + Vec2<double>{border + 0.5, border + 0.5};
    tile.rect.width = static_cast<int>(std::ceil(length)) + 1 + 2 * border;
    tile.rect.height = static_cast<int>(std::ceil(across)) + 1 + 2 * border;
}

void place_chart(double scale, Chart& chart) {
    chart.left = static_cast<int>(std::floor(chart.bounds[0] * scale)) - kBorder_px;
    chart.top = static_cast<int>(std::floor(chart.bounds[1] * scale)) - kBorder_px;
    chart.rect.width =
        static_cast<int>(std::ceil(chart.bounds[2] * scale)) + kBorder_px - chart.left;
    chart.rect.height =
        static_cast<int>(std::ceil(chart.bounds[3] * scale)) + kBorder_px - chart.top;
}

/// Packs rectangles into shelves of the given width. Returns the height; nothing if above `most`.
std::optional<int> pack(std::vector<Rect*>& rects, int width, int most) {
    int x = 0, y = 0, shelf = 0;
    for (Rect* const rect : rects) {
        if (rect->width > width) return std::nullopt;
        if (x + rect->width > width) y += shelf, x = 0, shelf = 0;
        if (y + rect->height > most) return std::nullopt;
        rect->x = x, rect->y = y;
        x += rect->width, shelf = std::max(shelf, rect->height);
    }
    return y + shelf;
}

/// Whether everything fits at `scale`; sets sizes and places.
bool fit(const TriangleMesh& mesh, Atlas& atlas, bool flat, double scale, int width) {
    atlas.scale = scale;
    std::vector<Rect*> rects;
    for (Chart& chart : atlas.charts) place_chart(scale, chart), rects.push_back(&chart.rect);
    for (Tile& tile : atlas.tiles)
        if (tile.same_as < 0) place_tile(mesh, scale, flat, tile), rects.push_back(&tile.rect);
    std::ranges::stable_sort(rects, [](const Rect* a, const Rect* b) {
        return std::tie(a->height, a->width) > std::tie(b->height, b->width);
    });
    const std::optional<int> height = pack(rects, width, width);
    if (!height) return false;
    atlas.width = width, atlas.height = 4;
    // Old devices need powers of two. A given width may be none.
    while (atlas.height < *height) atlas.height = std::min(2 * atlas.height, width);
    return true;
}

/// Makes unseen faces of similar colour share a tile if there are too many for their own.
void share_tiles(const TriangleMesh& mesh, std::vector<Tile>& tiles) {
    std::map<int, int> first;
    for (std::size_t i = 0; i < tiles.size(); ++i) {
        if (tiles[i].seen) continue;
        int key = 0;
        for (int channel = 0; channel < 3 && !mesh.colors.empty(); ++channel) {
            float sum = 0;
            for (int c = 0; c < 3; ++c)
                sum += mesh.colors[mesh.faces[tiles[i].face][c]][channel] / 3;
            key = key * kColorSteps +
                  std::clamp(static_cast<int>(sum * kColorSteps), 0, kColorSteps - 1);
        }
        const auto [at, is_new] = first.try_emplace(key, static_cast<int>(i));
        if (!is_new) tiles[i].same_as = at->second;
    }
}

}  // namespace

Atlas lay_out(const Subject& in,
              const std::vector<int>& view_of_face,
              int max_side,
              bool fixed_side) {
    const TriangleMesh& mesh = in.mesh;
    Atlas atlas;
    atlas.charts = charts_of(in, view_of_face);
    double unseen = 0;
    for (std::size_t f = 0; f < view_of_face.size(); ++f) {
        if (view_of_face[f] >= 0) continue;
        atlas.tiles.push_back(tile_of(mesh, static_cast<int>(f), in.candidates.seen_pixel[f]));
        unseen += !atlas.tiles.back().seen;
    }
    const double tile_area = (kUnseenLength + 3) * (kUnseenLength + 3);
    const bool flat = unseen * tile_area > kShareOfUnseen * max_side * double(max_side);
    if (flat) share_tiles(mesh, atlas.tiles);
    for (int side = fixed_side ? max_side : kMinSide; side <= max_side; side *= 2)
        if (fit(mesh, atlas, flat, 1, side)) return atlas;
    for (double scale = kStep; scale > kMinScale; scale *= kStep)
        if (fit(mesh, atlas, flat, scale, max_side)) return atlas;
    throw Error(ExitCode::input, "too many charts for a texture of ", max_side, "x", max_side, ": ",
                atlas.charts.size(), " and ", atlas.tiles.size(),
                " single faces; make a coarser mesh, or pass --texture none");
}

}  // namespace tvsgs::texture
