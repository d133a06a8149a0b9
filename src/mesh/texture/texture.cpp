#include "mesh/texture/texture.h"

#include <algorithm>

#include "mesh/texture/texture_steps.h"

namespace tvsgs {
namespace texture {
namespace {

/// Sets the texture coordinates of all faces.
void set_places(const Subject& in, const Atlas& atlas, MeshTexture& out) {
    const TriangleMesh& mesh = in.mesh;
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
                        in.views[chart.view].project(vec_cast<double>(mesh.vertices[vertex]));
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

}  // namespace
}  // namespace texture

MeshTexture make_texture(const TriangleMesh& mesh,
                         const std::vector<View>& views,
                         const TextureOptions& options,
                         TextureReport* report) {
    using namespace texture;
    MeshTexture out;
    if (mesh.faces.empty()) return out;
    StageClock<Cpu> clock(report != nullptr);
    std::vector<PhotoView> photos = photo_views(views, options.masks);
    Sights sights(mesh, photos);
    Candidates candidates = clock("views", [&] { return find_candidates(mesh, photos, sights); });
    clock("exposures", [&] { level_exposures(candidates, photos), drop_outliers(candidates); });
    const std::vector<SharedEdge> edges = clock("edges", [&] { return shared_edges(mesh); });
    const Subject in{mesh, photos, candidates, edges};
    const std::vector<int> view_of_face = clock("choice", [&] { return choose_views(in); });
    const Atlas atlas = clock(
        "charts", [&] { return lay_out(in, view_of_face, options.max_side, options.fixed_side); });
    int compared = 0;
    const std::vector<Correction> corrections =
        clock("seams", [&] { return level_seams(in, atlas.charts, compared); });
    out.image = clock("pixels", [&] { return fill_texture(in, atlas, corrections, sights); });
    clock("places", [&] { set_places(in, atlas, out); });

    if (report) {
        *report = {};
        std::vector<char> used(photos.size(), 0);
        for (const Chart& chart : atlas.charts) used[chart.view] = 1;
        report->views_used = static_cast<int>(std::ranges::count(used, 1));
        report->charts = static_cast<int>(atlas.charts.size());
        report->tiles = static_cast<int>(atlas.tiles.size());
        for (const Tile& tile : atlas.tiles) report->unseen += !tile.seen;
        report->seams = compared, report->scale = atlas.scale;
        report->stages = clock.stages();
    }
    return out;
}

}  // namespace tvsgs
