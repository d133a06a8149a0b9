// The tetrahedra mesher: its cases, its colours, and whole meshes of known surfaces.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "core/error.h"
#include "mesh/splat_surfaces.h"
#include "mesh/tetrahedra/mesher_tetrahedra.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

using test::Random;

Vec3d corner(const TriangleMesh& mesh, int i) {
    return vec_cast<double>(mesh.vertices[static_cast<std::size_t>(i)]);
}
Vec3d face_normal(const TriangleMesh& mesh, Vec3i f) {
    return cross(corner(mesh, f.y) - corner(mesh, f.x), corner(mesh, f.z) - corner(mesh, f.x));
}

struct Topology {
    // Edges of one face; of more than two faces, or with a reversed face.
    int boundary_edges = 0, shared_wrong = 0;
    long euler = 0;
};
Topology topology(const TriangleMesh& mesh) {
    std::map<std::pair<int, int>, std::pair<int, int>> edges;  // faces in and against its direction
    std::set<int> vertices;
    for (const Vec3i f : mesh.faces)
        for (int k = 0; k < 3; ++k) {
            const int a = f[k], b = f[(k + 1) % 3];
            vertices.insert(a);
            auto& [along, against] = edges[std::minmax(a, b)];
            ++(a < b ? along : against);
        }
    Topology t;
    for (const auto& [edge, faces] : edges) {
        t.boundary_edges += faces.first + faces.second == 1;
        t.shared_wrong += faces.first > 1 || faces.second > 1;
    }
    t.euler = static_cast<long>(vertices.size()) - static_cast<long>(edges.size()) +
              static_cast<long>(mesh.faces.size());
    return t;
}

/// Puts vertices at the centres of the edges.
TriangleMesh halfway(const TetrahedraSurface& surface, const std::vector<Vec3f>& positions) {
    TriangleMesh mesh;
    mesh.faces = surface.faces;
    for (const CrossedEdge& e : surface.edges)
        mesh.vertices.push_back(0.5f * (positions[static_cast<std::size_t>(e.free_end)] +
                                        positions[static_cast<std::size_t>(e.inside_end)]));
    return mesh;
}

const std::vector<Vec3f> kCorners{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};

TEST(MarchingTetrahedra, AllCasesFaceFreeSpace) {
    for (int inside = 0; inside < 16; ++inside) {
        std::vector<PointSide> sides;
        int count = 0;
        for (int i = 0; i < 4; ++i) {
            sides.push_back(inside >> i & 1 ? PointSide::inside : PointSide::free);
            count += inside >> i & 1;
        }
        const TetrahedraSurface surface =
            marching_tetrahedra({{0, 1, 2, 3}}, sides, kCorners, std::vector<float>(4, 1));
        const int faces = count == 2 ? 2 : count == 0 || count == 4 ? 0 : 1;
        ASSERT_EQ(static_cast<int>(surface.faces.size()), faces) << inside;
        EXPECT_EQ(static_cast<int>(surface.edges.size()), count * (4 - count)) << inside;
        const TriangleMesh mesh = halfway(surface, kCorners);
        double area = 0;
        for (const Vec3i f : mesh.faces) {
            const Vec3d n = face_normal(mesh, f);
            area += norm(n) / 2;
            for (int i = 0; i < 4; ++i) {
                const double side = dot(
                    n, vec_cast<double>(kCorners[static_cast<std::size_t>(i)]) - corner(mesh, f.x));
                EXPECT_GT(inside >> i & 1 ? -side : side, 0)
                    << "case " << inside << ", corner " << i;
            }
        }
        // Halves of a rectangle of 1 / 2 by 1 / sqrt 2 that do not overlap.
        if (count == 2) {
            EXPECT_NEAR(area, 1 / std::sqrt(8.0), 1e-6) << inside;
        }
        EXPECT_EQ(topology(mesh).shared_wrong, 0) << inside;
    }
}

TEST(MarchingTetrahedra, AnyFieldGivesAClosedManifold) {
    Random random(2);
    std::vector<Vec3i> grid;
    std::vector<Vec3f> positions;
    std::vector<PointSide> sides;
    for (int i = 0; i < 600; ++i) {
        Vec3i p;
        for (int axis = 0; axis < 3; ++axis) p[axis] = static_cast<int>(random.uniform(1000, 9000));
        grid.push_back(p);
        sides.push_back(random.uniform(0, 1) < 0.4 ? PointSide::inside : PointSide::free);
    }
    for (int k = 0; k < 8; ++k) {
        grid.push_back({k & 1 ? 10000 : 0, k & 2 ? 10000 : 0, k & 4 ? 10000 : 0});
        sides.push_back(PointSide::free);
    }
    for (const Vec3i p : grid) positions.push_back(vec_cast<float>(p));
    const auto tetrahedra = delaunay(grid);
    const TetrahedraSurface surface =
        marching_tetrahedra(tetrahedra, sides, positions, std::vector<float>(grid.size(), 1e5f));
    const Topology t = topology(halfway(surface, positions));
    EXPECT_GT(surface.faces.size(), 2000u);
    EXPECT_EQ(t.boundary_edges, 0);
    EXPECT_EQ(t.shared_wrong, 0);
    EXPECT_EQ(t.euler % 2, 0);
    std::set<std::pair<int, int>> edges;
    for (const CrossedEdge& e : surface.edges) {
        EXPECT_EQ(sides[static_cast<std::size_t>(e.free_end)], PointSide::free);
        EXPECT_EQ(sides[static_cast<std::size_t>(e.inside_end)], PointSide::inside);
        EXPECT_TRUE(edges.insert({e.free_end, e.inside_end}).second);
    }
}

TEST(MarchingTetrahedra, LeavesOutCaps) {
    std::vector<PointSide> sides(4, PointSide::free);
    sides[0] = PointSide::inside;
    const std::vector<Tetrahedron> one{{0, 1, 2, 3}};
    // The edges have length 1.
    std::vector<float> radii{0.6f, 0.5f, 0.41f, 0.4f};
    EXPECT_EQ(marching_tetrahedra(one, sides, kCorners, radii).faces.size(), 1u);
    radii[3] = 0.39f;
    TetrahedraSurface surface = marching_tetrahedra(one, sides, kCorners, radii);
    EXPECT_TRUE(surface.faces.empty() && surface.edges.empty());
    EXPECT_EQ(surface.far_faces, 1);
    // An unseen point makes no surface unless another corner is hidden.
    radii.assign(4, 1);
    sides[0] = PointSide::unseen;
    surface = marching_tetrahedra(one, sides, kCorners, radii);
    EXPECT_TRUE(surface.faces.empty());
    EXPECT_EQ(surface.unseen_faces, 1);
    sides[1] = PointSide::inside;
    EXPECT_EQ(marching_tetrahedra(one, sides, kCorners, radii).faces.size(), 2u);
    sides[1] = PointSide::unseen;
    EXPECT_EQ(marching_tetrahedra(one, sides, kCorners, radii).unseen_faces, 2);
}

TEST(VertexColors, AreThoseOfPixelsThatShowTheVertex) {
    // A wall at depth 2, red in one camera and green in another of half the resolution.
    struct Wall {
        Camera camera;
        std::vector<float> depth;
        std::vector<Vec3f> color;
    };
    std::vector<Wall> walls;
    for (const int size : {40, 20}) {
        const auto pixels = static_cast<std::size_t>(size * size);
        const Vec3f color = size == 40 ? Vec3f{1, 0, 0} : Vec3f{0, 1, 0};
        walls.push_back({test::look_at_origin({0, 0, 2}, size), std::vector<float>(pixels, 2),
                         std::vector<Vec3f>(pixels, color)});
    }
    walls[0].depth[20 * 40 + 30] = 0;  // a pixel without depth
    // On the wall; a pixel of the first camera (2 / 40) behind it; far behind; outside of the
    // images; in the pixel without depth.
    const float x = 2 * (30.5f - 20) / 40, y = 2 * (20.5f - 20) / 40;
    const auto vertices = to_device<Cpu>(std::vector<Vec3f>{
        {0.01f, 0.01f, 0}, {0.01f, 0.01f, -0.05f}, {0, 0, -2}, {0, 3, 0}, {x, -y, 0}});
    Buffer<ColorSum, Cpu> sums(5);
    sums.fill_zero();
    for (const Wall& wall : walls)
        add_colors({wall.camera,
                    {wall.depth.data(), wall.depth.size()},
                    {wall.color.data(), wall.color.size()}},
                   vertices, sums);
    const std::vector<CrossedEdge> edges(5, {0, 1});
    const std::vector<Vec3f> colors =
        detail::mean_colors(to_host(sums), edges, {2, -1}, {{}, {}, {1, 0, -9}});
    EXPECT_NEAR(colors[0].x, 0.8, 1e-6);  // weighted by the squared resolutions
    EXPECT_NEAR(colors[0].y, 0.2, 1e-6);
    const double z = 2.05, d1 = 0.05 * 40 / z, d2 = 0.05 * 20 / z;
    const double w1 = 1600 / std::pow(1 + d1 * d1, 2), w2 = 400 / std::pow(1 + d2 * d2, 2);
    EXPECT_NEAR(colors[1].x, w1 / (w1 + w2), 1e-5);
    for (const int unseen : {2, 3}) {  // the colour of the splat; the other end has none
        EXPECT_NEAR(colors[std::size_t(unseen)].x, 0.78209, 1e-4);
        EXPECT_EQ(colors[std::size_t(unseen)].y, 0.5f);
        EXPECT_EQ(colors[std::size_t(unseen)].z, 0);
    }
    EXPECT_EQ(colors[4].y, 1);
}

constexpr std::int64_t kPlenty = std::int64_t{1} << 30;

template <class Device = Cpu>
ExtractedMesh extract(const Gaussians<Cpu>& gaussians,
                      const std::vector<View>& views,
                      const TetrahedraMesherOptions& options = {},
                      std::int64_t max_bytes = kPlenty) {
    const auto backbone = make_backbone<Device>("ewa", {});
    Gaussians<Device> g;
    copy(gaussians, g);
    DepthRules rules;
    rules.depth_max = 100, rules.alpha_min = 0.5f;
    DepthViews<Device> depth(views, g, *backbone, rules, true);
    TetrahedraMesher<Device> mesher(options);
    const MeshRegion region{false, {}, 3};
    return mesher.extract({views, g, *backbone, depth, region, 0.2f, max_bytes, ""});
}

void expect_sphere(const TriangleMesh& mesh, double size, double bound) {
    const Topology t = topology(mesh);
    EXPECT_EQ(t.boundary_edges, 0);
    EXPECT_EQ(t.shared_wrong, 0);
    EXPECT_EQ(t.euler, 2);
    double sum = 0, farthest = 0;
    for (const Vec3f v : mesh.vertices) {
        const double error = std::abs(norm(vec_cast<double>(v)) - 1);
        sum += error, farthest = std::max(farthest, error);
    }
    EXPECT_LT(sum / static_cast<double>(mesh.vertices.size()), bound * size);
    EXPECT_LT(farthest, 0.5 * size);
    double volume = 0;  // positive if faces are oriented outwards
    for (const Vec3i f : mesh.faces) volume += dot(face_normal(mesh, f), corner(mesh, f.x)) / 6;
    EXPECT_NEAR(volume, 4 * M_PI / 3, 3 * 4 * M_PI / 3 * bound * size + 0.02);
    ASSERT_EQ(mesh.colors.size(), mesh.vertices.size());
    double color_error = 0;  // at an outline a pixel partly shows the background: no surface
    for (const Vec3f c : mesh.colors)
        color_error =
            std::max(color_error, norm(vec_cast<double>(c - Vec3f{0.782f, 0.5f, 0.218f})));
    EXPECT_LT(color_error, 0.12);
}

TEST(TetrahedraMesher, SphereIsClosedAndExact) {
    const int count = 800;
    const double size = 2 / std::sqrt(count);
    // Surfels of a thousandth, PGSR's flat splats, and thicker ones.
    for (const double flatness : {1e-3, 1e-6, 0.1}) {
        const ExtractedMesh found =
            extract(test::sphere_splats(count, 1, flatness), test::views_around(14, 48));
        EXPECT_EQ(found.why_empty, "");
        EXPECT_GT(found.mesh.faces.size(), 3000u);
        // A thick splat occludes points inside of it: the surface is 1 to 2 thicknesses too far
        // out.
        expect_sphere(found.mesh, size, flatness > 0.01 ? 0.25 : 0.08);
    }
}

TEST(TetrahedraMesher, SphereWithFilter) {
    const int count = 800;
    Gaussians<Cpu> g = test::sphere_splats(count, 1, 1e-4);
    g.filter.resize(count);
    // Widens them to a fortieth of their width; raises the opacity, which the filter lowers.
    for (float& f : g.filter.span()) f = static_cast<float>(2 / std::sqrt(count) / 40);
    const auto at_most_half = extract(g, test::views_around(14, 48));
    EXPECT_NE(at_most_half.why_empty, "") << "filtered to an opacity of 0.004";
    for (Vec3f& s : g.log_scales.span()) s.z = s.x - std::log(40.0f);
    const ExtractedMesh found = extract(g, test::views_around(14, 48));
    expect_sphere(found.mesh, 2 / std::sqrt(count), 0.12);
}

TEST(TetrahedraMesher, PlaneOfThreeViews) {
    const std::vector<View> views{test::view_from({0, 0, 3}, 96), test::view_from({1, 0.3, 3}, 96),
                                  test::view_from({-0.8, 0.7, 3}, 96)};
    const ExtractedMesh found = extract(test::plane_splats(30, 1e-3), views);
    ASSERT_GT(found.mesh.faces.size(), 1000u);
    double sum = 0, up = 0, area = 0;
    for (const Vec3f v : found.mesh.vertices) sum += std::abs(double(v.z));
    // Splats of 0.04 side by side, seen with pixels of 0.03.
    EXPECT_LT(sum / static_cast<double>(found.mesh.vertices.size()), 0.004);
    for (const Vec3i f : found.mesh.faces) {
        const Vec3d n = face_normal(found.mesh, f);
        up += n.z / 2, area += norm(n) / 2;
    }
    EXPECT_NEAR(up, 4, 0.3);  // one sheet of the square, seen from above
    EXPECT_LT(area, 1.1 * up);
    EXPECT_EQ(topology(found.mesh).shared_wrong, 0);
}

TEST(TetrahedraMesher, KeepsToItsBudget) {
    const Gaussians<Cpu> g = test::sphere_splats(900, 1, 1e-3);
    const auto views = test::views_around(14, 48);
    // Room for a third of the points.
    const std::int64_t bytes = 900 * kFieldBytesPerSplat + 600 * kPivotBytes;
    const ExtractedMesh found = extract(g, views, {}, bytes);
    const ExtractedMesh all = extract(g, views);
    EXPECT_GT(found.mesh.faces.size(), 200u);
    EXPECT_LT(found.mesh.faces.size(), all.mesh.faces.size() / 2);
    double sum = 0;
    for (const Vec3f v : found.mesh.vertices) sum += std::abs(double(norm(v)) - 1);
    EXPECT_LT(sum / static_cast<double>(found.mesh.vertices.size()), 0.02);
    EXPECT_EQ(topology(found.mesh).euler, 2);
    try {
        extract(g, views, {}, 900 * kFieldBytesPerSplat);
        FAIL() << "no points fit";
    } catch (const Error& e) {
        EXPECT_EQ(e.code(), ExitCode::memory);
        EXPECT_NE(std::string(e.what()).find("raise --memory"), std::string::npos) << e.what();
    }
}

TEST(TetrahedraMesher, SaysWhyThereIsNothing) {
    const auto views = test::views_around(5, 32);
    Gaussians<Cpu> g;
    resize(g, 0, 0);
    EXPECT_NE(extract(g, views).why_empty.find("none of the 0 splats"), std::string::npos);
    g = test::sphere_splats(1, 1, 0.01);
    EXPECT_NE(extract(g, views).why_empty.find("in one point"), std::string::npos);
    for (View& view : const_cast<std::vector<View>&>(views)) view.mask = ImageU8(32, 32, 1, 0);
    g = test::sphere_splats(100, 1, 0.01);
    EXPECT_NE(extract(g, views).why_empty.find("--no-masks"), std::string::npos);
}

TEST(TetrahedraMesher, HostileSplatsChangeNothing) {
    const int count = 500;
    const float nan = std::nanf(""), inf = INFINITY;
    Gaussians<Cpu> g = test::sphere_splats(count, 1, 1e-3);
    const ExtractedMesh clean = extract(g, test::views_around(10, 48));
    Gaussians<Cpu> more = test::sphere_splats(count + 7, 1, 1e-3);
    const auto to = [&](int i) { return static_cast<std::size_t>(i); };
    for (int i = 0; i < count; ++i) {
        more.means[to(i)] = g.means[to(i)], more.quats[to(i)] = g.quats[to(i)];
        more.log_scales[to(i)] = g.log_scales[to(i)];
    }
    more.means[to(count)] = {nan, 0, 0}, more.log_scales[to(count + 1)].x = nan;
    more.quats[to(count + 2)].x = inf, more.opacity_logits[to(count + 3)] = nan;
    more.means[to(count + 4)] = {1e30f, 0, 0}, more.log_scales[to(count + 5)] = {88, 88, 88};
    more.log_scales[to(count + 6)] = {-90, -90, -200};
    const ExtractedMesh hostile = extract(more, test::views_around(10, 48));
    EXPECT_EQ(topology(hostile.mesh).shared_wrong, 0);
    EXPECT_NEAR(static_cast<double>(hostile.mesh.faces.size()),
                static_cast<double>(clean.mesh.faces.size()), 100);
    for (const Vec3f v : hostile.mesh.vertices) ASSERT_TRUE(is_finite(v));
}

TEST(TetrahedraMesherTwin, SameMesh) {
    if (const std::string why = test::no_cuda(); !why.empty()) GTEST_SKIP() << why;
    if constexpr (kHasCuda) {
        const Gaussians<Cpu> g = test::sphere_splats(900, 1, 1e-3);
        const auto views = test::views_around(14, 48);
        const ExtractedMesh host = extract(g, views), device = extract<Cuda>(g, views);
        // The points have the same bits; a point near the threshold may differ.
        EXPECT_NEAR(static_cast<double>(device.mesh.faces.size()),
                    static_cast<double>(host.mesh.faces.size()), 20);
        if (device.mesh.vertices.size() == host.mesh.vertices.size()) {
            std::size_t elsewhere = 0;
            for (std::size_t i = 0; i < host.mesh.vertices.size(); ++i)
                elsewhere += norm(host.mesh.vertices[i] - device.mesh.vertices[i]) > 1e-5f;
            EXPECT_LE(elsewhere, host.mesh.vertices.size() / 100);
        }
        expect_sphere(device.mesh, 2 / std::sqrt(900.0), 0.08);
    }
}

}  // namespace
}  // namespace tvsgs
