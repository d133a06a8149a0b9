// Tests the verdicts of views on a surface, and which components they keep.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "core/device/threads.h"
#include "core/scene/scene.h"
#include "mesh/evidence_scenes.h"
#include "mesh/mend/mend.h"
#include "pipeline/mesh/mesh_output.h"

namespace tvsgs {
namespace {

using namespace test;

/// A view along +z of 100 x 100 pixels with constant depth.
EvidenceView level(float depth, float weight = kTrustedWeight) {
    EvidenceView view;
    view.camera = {100, 100, 100, 50, 50, 50, {}};
    view.depth.assign(10000, depth), view.weight.assign(10000, weight);
    return view;
}
SurfaceSample facing(float z, float area = 1) {
    return {{0, 0, z}, {0, 0, -area}};
}

TEST(Verdict, SeesWithinThreePixels) {
    // A pixel at depth 2 is 0.02 wide.
    for (const float off : {-0.059f, 0.0f, 0.059f}) {
        EXPECT_EQ(judge(level(2 - off), facing(2)).verdict, Verdict::sees_surely) << off;
        EXPECT_EQ(judge(level(2 - off, kDoubtedWeight), facing(2)).verdict, Verdict::sees) << off;
    }
    EXPECT_EQ(judge(level(2.061f), facing(2)).verdict, Verdict::looks_through);
    EXPECT_EQ(judge(level(2.061f, kDoubtedWeight), facing(2)).verdict, Verdict::looks_past);
    EXPECT_EQ(judge(level(1.939f), facing(2)).verdict, Verdict::nothing) << "hidden";
}

TEST(Verdict, SlantedPixelsAreWider) {
    // At 60 degrees a pixel is twice as wide; of a surface seen edge-on ten times.
    const SurfaceSample slanted{{0, 0, 2}, {std::sqrt(3.0f), 0, -1}};
    EXPECT_EQ(judge(level(2.119f), slanted).verdict, Verdict::sees_surely);
    EXPECT_EQ(judge(level(2.121f), slanted).verdict, Verdict::looks_through);
    const SurfaceSample grazing{{0, 0, 2}, {1, 0, -0.001f}};
    EXPECT_EQ(judge(level(2.599f), grazing).verdict, Verdict::sees_surely);
    EXPECT_EQ(judge(level(2.601f), grazing).verdict, Verdict::looks_through);
    // The ray counts, not the optical axis: 45 degrees off the axis, this sample is seen from
    // behind.
    const SurfaceSample aside{{0.9f, 0, 2}, {1, 0, -0.4f}};
    EXPECT_EQ(judge(level(2), aside).verdict, Verdict::nothing);
}

TEST(Verdict, WhatLooksAwayIsNotSeenButLookedThrough) {
    const SurfaceSample averted{{0, 0, 2}, {0, 0, 1}};
    EXPECT_EQ(judge(level(2), averted).verdict, Verdict::nothing);
    EXPECT_EQ(judge(level(3), averted).verdict, Verdict::looks_through);
}

TEST(Verdict, NothingWhereNothingIsKnown) {
    const float nan = std::numeric_limits<float>::quiet_NaN();
    EXPECT_EQ(judge(level(0), facing(2)).verdict, Verdict::nothing);
    EXPECT_EQ(judge(level(nan), facing(2)).verdict, Verdict::nothing);
    EXPECT_EQ(judge(level(2), facing(-2)).verdict, Verdict::nothing);
    EXPECT_EQ(judge(level(2), facing(nan)).verdict, Verdict::nothing);
    EXPECT_EQ(judge(level(2), {{0, 0, 2}, {}}).verdict, Verdict::nothing) << "no normal";
    EXPECT_EQ(judge(level(2), {{1.01f, 0, 2}, {0, 0, -1}}).verdict, Verdict::nothing);
    EXPECT_EQ(judge(level(2), {{-1.01f, 0, 2}, {0, 0, -1}}).verdict, Verdict::nothing);
    EXPECT_EQ(judge(level(2), {{0, 2.01f, 2}, {0, 0, -1}}).verdict, Verdict::nothing);
    EXPECT_EQ(judge(level(2), {{0.99f, 1.99f, 2}, {0, 0, -1}}).verdict, Verdict::sees_surely);
}

TEST(Verdict, MasksCountWhereThereIsNoDepth) {
    EvidenceView view = level(0);
    view.mask.assign(view.depth.size(), 0);
    EXPECT_EQ(judge(view, facing(2)).verdict, Verdict::off_object);
    EXPECT_EQ(judge(view, facing(-2)).verdict, Verdict::nothing) << "behind the camera";
    view.mask.assign(view.depth.size(), 128);
    EXPECT_EQ(judge(view, facing(2)).verdict, Verdict::nothing);
    view.mask.assign(view.depth.size(), kNoPhoto);
    EXPECT_EQ(judge(view, facing(2)).verdict, Verdict::nothing) << "no lens saw it";
    EvidenceView seen = level(2);
    seen.mask.assign(seen.depth.size(), 0);
    EXPECT_EQ(judge(seen, facing(2)).verdict, Verdict::sees_surely);
    EXPECT_TRUE(contradicts(Verdict::off_object) && contradicts(Verdict::looks_past) &&
                contradicts(Verdict::looks_through));
    EXPECT_FALSE(contradicts(Verdict::nothing) || contradicts(Verdict::sees) ||
                 contradicts(Verdict::sees_surely));
}

TEST(Verdict, PixelsAreThoseOfTheImage) {
    // Focal lengths of 100 and 50: a square of side 0.1 at depth 2 covers 5 x 2.5 pixels.
    EXPECT_NEAR(judge(level(2), facing(2, 0.01f)).pixels, 12.5, 1e-4);
    // Equals the image of a triangle off the axis, for any slant.
    const Vec3d p[3] = {{0.8, 0.5, 2}, {0.802, 0.5, 2.003}, {0.8, 0.503, 2.001}};
    const Vec3d n = cross(p[2] - p[0], p[1] - p[0]);
    const auto image = [](Vec3d q) { return Vec2<double>{100 * q.x / q.z, 50 * q.y / q.z}; };
    const Vec2<double> a = image(p[1]) - image(p[0]), b = image(p[2]) - image(p[0]);
    const SurfaceSample sample{vec_cast<float>(1.0 / 3 * (p[0] + p[1] + p[2])),
                               vec_cast<float>(0.5 * n)};
    const double expected = 0.5 * std::abs(a.x * b.y - a.y * b.x);
    EXPECT_NEAR(judge(level(2), sample).pixels, expected, 2e-3 * expected);
}

TEST(Evidence, CountsViewsOfFacesAndVertices) {
    const TriangleMesh wall = sheet(0, 0, 0, 2, 8);
    std::vector<EvidenceView> views = views_of(wall);
    views.push_back(view_of(wall, {0, 0, 5}, false));
    const auto evidence = gather_evidence(source_of(views), face_samples(wall));
    ASSERT_EQ(evidence.size(), wall.faces.size());
    for (const Evidence& e : evidence) {
        EXPECT_EQ(e.sees, 4);
        EXPECT_EQ(e.surely, 3);
    }
    TriangleMesh counted = wall;
    count_views(counted, source_of(views));
    ASSERT_EQ(counted.views.size(), wall.vertices.size());
    EXPECT_EQ(counted.views[4 * 9 + 4], 3);  // the middle
    // Counts end at 255.
    const std::vector<EvidenceView> many(300, view_of(wall, {0, 0, 5}));
    count_views(counted, source_of(many));
    EXPECT_EQ(counted.views[4 * 9 + 4], 255);
    // The numbers of removed vertices go, too.
    counted.views.assign(counted.views.size(), 1);
    counted.views.back() = 7;
    std::vector<char> last(wall.faces.size());
    last.back() = true;
    filter_faces(counted, last);
    EXPECT_EQ(counted.views, (std::vector<std::uint8_t>{1, 1, 7}));

    TriangleMesh none;
    count_views(none, {1, [](int) -> EvidenceView { throw std::runtime_error("not needed"); }});
    EXPECT_TRUE(none.views.empty());
}

/// Number of faces of `mesh` that are kept; logs the report if a test fails.
std::size_t faces_left(TriangleMesh mesh, const std::vector<EvidenceView>& views) {
    keep_seen_components(mesh, source_of(views));
    return mesh.faces.size();
}

TEST(Components, AFloatingSheetGoesHoweverLarge) {
    // View 0 sees the floating sheet, because its splats show it; the others look through it at the
    // wall.
    const TriangleMesh wall = sheet(0, 0, 0, 3, 10), floating = sheet(-0.5, 0, 2, 1, 40);
    TriangleMesh mesh = joined({wall, floating});
    ASSERT_GT(floating.faces.size(), 10 * wall.faces.size());
    std::vector<EvidenceView> views = views_of(wall);
    views[0] = view_of(mesh, kEyes[0]);
    const EvidenceReport report = keep_seen_components(mesh, source_of(views));
    EXPECT_EQ(report.components, 2u);
    EXPECT_EQ(report.kept_components, 1u);
    EXPECT_EQ(report.looked_through, 1u);
    EXPECT_EQ(report.single_view, 0u);
    EXPECT_EQ(mesh.faces.size(), wall.faces.size());
    EXPECT_EQ(mesh.vertices.size(), wall.vertices.size());
    // A second view that sees it is not enough: one view of two still looks through.
    const TriangleMesh both = joined({wall, floating});
    views[1] = view_of(both, kEyes[1]);
    EXPECT_EQ(faces_left(both, views), wall.faces.size());
    // Three views that see it outweigh one, as for a rod that is too thin for one of many views.
    views.push_back(view_of(both, {0.2, 0, 5}));
    EXPECT_EQ(faces_left(both, views), both.faces.size());
    views.push_back(views[2]), views[4].weight.assign(views[4].weight.size(), kDoubtedWeight);
    EXPECT_EQ(faces_left(both, views), both.faces.size()) << "doubted pixels take nothing away";
    views[4] = views[2];
    EXPECT_EQ(faces_left(both, views), wall.faces.size()) << "two against three";
}

TEST(Components, AQuarterMayBeLookedThrough) {
    // The other views see the sheet without its left margin.
    const TriangleMesh wall = sheet(0, 0, 0, 3, 10), whole = sheet(0, 0, 1, 1, 40);
    const auto kept = [&](double missing) {
        const TriangleMesh less = [&] {
            TriangleMesh part;
            add_patch(part, 40, [&](double u, double v) {
                return Vec3d{-0.5 + missing + u * (1 - missing), v - 0.5, 1};
            });
            return part;
        }();
        const TriangleMesh seen = joined({wall, less});
        std::vector<EvidenceView> views = views_of(seen);
        views[0] = view_of(joined({wall, whole}), kEyes[0]);
        return faces_left(joined({wall, whole}), views) > wall.faces.size();
    };
    EXPECT_TRUE(kept(0.2));
    EXPECT_FALSE(kept(0.3));
}

TEST(Components, ABoltStaysACrumbBehindGoes) {
    // 20 faces that cover 30 pixels, in front of the wall; behind it 800 faces that no view sees.
    const TriangleMesh wall = sheet(0, 0, 0, 3, 10);
    const double side = std::sqrt(30.0) * 4.8 / 200;
    TriangleMesh bolt;  // 2 x 5 squares
    for (int j = 0; j <= 5; ++j)
        for (int i = 0; i <= 2; ++i)
            bolt.vertices.push_back(vec_cast<float>(Vec3d{side * i / 2, side * j / 5, 0.2}));
    for (int j = 0; j < 5; ++j)
        for (int i = 0; i < 2; ++i) {
            const int a = 3 * j + i;
            bolt.faces.push_back({a, a + 1, a + 4});
            bolt.faces.push_back({a, a + 4, a + 3});
        }
    ASSERT_EQ(bolt.faces.size(), 20u);
    const TriangleMesh seen = joined({wall, bolt}), hidden = sheet(0, 0, -0.5, 1, 20);
    TriangleMesh mesh = joined({hidden, seen});
    const EvidenceReport report = keep_seen_components(mesh, source_of(views_of(seen)));
    EXPECT_EQ(report.kept_components, 2u);
    EXPECT_EQ(report.peeled_faces, hidden.faces.size());
    EXPECT_EQ(mesh.faces.size(), seen.faces.size());
    // At half the width it is too small in every view.
    TriangleMesh tiny = bolt;
    for (Vec3f& p : tiny.vertices) p.x *= 0.5f;
    const TriangleMesh with_tiny = joined({wall, tiny});
    EXPECT_EQ(faces_left(with_tiny, views_of(with_tiny)), wall.faces.size());
}

TEST(Components, ThinRodsStay) {
    // A rod one and a half pixels wide, in front of a wall and in front of nothing.
    const double w = 1.5 * 4 / 200;
    const TriangleMesh wall = sheet(0.6, 0, 0, 1.2, 4);
    const TriangleMesh rod = box({-1.2, 0.1, 1 - w}, {1.2, 0.1 + w, 1}, 30);
    TriangleMesh mesh = joined({wall, rod});
    std::vector<EvidenceView> views = views_of(mesh);
    const std::size_t top = faces_left(mesh, views);
    EXPECT_GT(top, wall.faces.size() + 30 * 30);
    const EvidenceReport report = keep_seen_components(mesh, source_of(views));
    EXPECT_EQ(report.looked_through + report.single_view, 0u);
    // From far away it is a fifth of a pixel wide: one view that misses it does not outweigh three
    // that see it.
    views.push_back(view_of(joined({wall, rod}), {0, 0, 30}));
    EXPECT_GT(faces_left(joined({wall, rod}), views), wall.faces.size() + 30 * 30);
}

TEST(Components, OfAMirrorsImagesTheFarthestIsLeft) {
    // Each view sees the reflection at another depth; no two views agree.
    const TriangleMesh wall = sheet(0, 0, 0, 1, 10);
    std::vector<TriangleMesh> images;
    TriangleMesh mesh = wall;
    std::vector<EvidenceView> views;
    for (int i = 0; i < 3; ++i) {
        images.push_back(sheet(0, 1, -0.5 - 0.4 * i, 0.8, 12));
        append(mesh, images.back());
        views.push_back(view_of(joined({wall, images.back()}), kEyes[i]));
    }
    const EvidenceReport report = keep_seen_components(mesh, source_of(views));
    EXPECT_EQ(report.looked_through, 2u);
    EXPECT_EQ(report.kept_components, 2u);
    for (const Vec3f p : mesh.vertices) EXPECT_TRUE(p.z == 0 || p.z < -1.2f) << p.z;
}

TEST(Components, OneViewIsEnoughWhereNoOtherLooks) {
    const TriangleMesh wall = sheet(0, 0, 0, 2, 10), aside = sheet(3.2, 0, 0, 0.6, 10);
    const TriangleMesh scene = joined({wall, aside});
    const auto views = [&](bool trusted) {
        // The last view looks past the wall.
        std::vector<EvidenceView> all{view_of(wall, {0, 0, 5}), view_of(wall, {0.2, 0, 5})};
        EvidenceView other = view_of(scene, {0, 0, 5}, trusted);
        other.camera.camera_from_world.t.x -= 3.2f;
        other.depth = render_mesh(scene, other.camera).depth.pixels;
        all.push_back(other);
        return all;
    };
    EXPECT_EQ(faces_left(scene, views(true)), scene.faces.size());
    EXPECT_EQ(faces_left(scene, views(false)), wall.faces.size()) << "not of doubted pixels";
    // Two views without trusted pixels are as good as one with them.
    std::vector<EvidenceView> two = views(false);
    two.push_back(two.back());
    EXPECT_EQ(faces_left(scene, two), scene.faces.size());
    // A second view that sees only a part: 10 pixels of it, and 20 pixels of the surface behind.
    std::vector<EvidenceView> other = views(true);
    other.push_back(other.back());
    for (float& depth : other.back().depth) depth += 1;
    EXPECT_EQ(faces_left(scene, other), wall.faces.size());
}

TEST(Components, OneViewIsNotEnoughWhereAnotherCouldSee) {
    // 5 x 5 pixels. The other view sees 19 of them and looks through less than a quarter.
    TriangleMesh patch;
    add_patch(patch, 5, [](double u, double v) { return Vec3d{0.1 * v, 0.2 * u, 2}; });
    const EvidenceView whole = level(2);
    EvidenceView part = whole;
    for (int i = 0; i < 6; ++i)
        part.depth[static_cast<std::size_t>(100 * (50 + i / 5) + 50 + i % 5)] = 3;
    const std::vector<EvidenceView> views{whole, part};
    EXPECT_EQ(faces_left(patch, {whole}), patch.faces.size());
    TriangleMesh mesh = patch;
    const EvidenceReport report = keep_seen_components(mesh, source_of(views));
    EXPECT_EQ(report.single_view, 1u);
    EXPECT_EQ(report.looked_through, 0u);
    EXPECT_TRUE(mesh.faces.empty());
}

TEST(Components, PeelsUnseenFacesOffTheBoundaries) {
    // The mesh's wall is larger than the scene's, and has a patch inside that no view sees.
    const TriangleMesh wall = sheet(0, 0, 0, 2, 20);
    TriangleMesh wide;
    add_patch(wide, 30, [](double u, double v) {
        return Vec3d{-1 + 3 * u, -1 + 2 * v, u > 2.0 / 3 ? -3 * (u - 2.0 / 3) : 0};
    });
    std::vector<EvidenceView> views = views_of(wall);
    for (EvidenceView& view : views)
        for (int y = 90; y < 105; ++y)
            for (int x = 95; x < 110; ++x) view.depth[static_cast<std::size_t>(200 * y + x)] = 0;
    TriangleMesh mesh = wide;
    const EvidenceReport report = keep_seen_components(mesh, source_of(views));
    EXPECT_NEAR(static_cast<double>(report.peeled_faces), 600, 90);  // ten of thirty columns
    EXPECT_EQ(report.components, 1u);
    for (const Vec3f p : mesh.vertices) EXPECT_LT(p.x, 1.11f);
    std::size_t inside = 0, before = 0;
    const auto near_middle = [](Vec3f p) { return std::abs(p.x) < 0.4f && std::abs(p.y) < 0.4f; };
    for (const Vec3f p : mesh.vertices) inside += near_middle(p);
    for (const Vec3f p : wide.vertices) before += near_middle(p);
    EXPECT_EQ(inside, before) << "a patch amid what is seen stays";
}

TEST(Components, OddInput) {
    TriangleMesh none;
    EXPECT_EQ(keep_seen_components(none, {}).components, 0u);
    const TriangleMesh wall = sheet(0, 0, 0, 2, 10);
    EXPECT_EQ(faces_left(wall, {}), 0u) << "no view";
    EXPECT_EQ(faces_left(wall, {view_of(wall, {0, 0, 5})}), wall.faces.size()) << "one view";
    TriangleMesh odd = wall;
    odd.faces.push_back({0, 0, 1});
    odd.vertices.push_back({0, 0, std::numeric_limits<float>::quiet_NaN()});
    odd.faces.push_back({0, 1, static_cast<int>(odd.vertices.size()) - 1});
    keep_seen_components(odd, source_of(views_of(wall)));
    EXPECT_EQ(odd.faces.size(), wall.faces.size());
}

TEST(Components, SayWhyNothingIsLeft) {
    const TriangleMesh wall = sheet(0, 0, 0, 3, 10), floating = sheet(-0.5, 0, 2, 1, 40);
    std::vector<EvidenceView> views = views_of(wall);
    views[0] = view_of(floating, kEyes[0]);
    TriangleMesh mesh = floating;
    MeshOptions options;
    MeshSummary summary;
    const std::string why = detail::clean_mesh(mesh, options, source_of(views), summary);
    EXPECT_TRUE(mesh.faces.empty());
    EXPECT_NE(why.find("1 looked through by a view"), std::string::npos) << why;
    EXPECT_NE(why.find("mesh.evidence=false"), std::string::npos) << why;
    EXPECT_EQ(summary.components, 0u);
    EXPECT_EQ(summary.removed_components, 1u);
    EXPECT_EQ(summary.small_components, 0u);
    summary = {};
    mesh = floating;
    options.evidence = false, options.clusters = 1;
    EXPECT_EQ(detail::clean_mesh(mesh, options, source_of(views), summary), "");
    EXPECT_EQ(summary.components, 1u);
    EXPECT_EQ(summary.removed_components, 0u);
    EXPECT_EQ(mesh.faces.size(), floating.faces.size());
    TriangleMesh none;
    options.evidence = true, options.clusters = 0;
    EXPECT_EQ(detail::clean_mesh(none, options, source_of(views), summary), "")
        << "the mesher has said why";
}

TEST(Components, AreCountedInTheSummary) {
    TriangleMesh mesh;
    mesh.faces.resize(2419);
    MeshTexture texture;
    MeshSummary summary;
    summary.components = 2;
    EXPECT_EQ(summary_text(summary, mesh, texture), "Mesh: 2,419 faces, 2 components");
    texture.image = ImageU8(256, 512, 3);
    summary.components = 1, summary.removed_components = summary.small_components = 113;
    summary.closed_holes = 34;
    EXPECT_EQ(summary_text(summary, mesh, texture),
              "Mesh: 2,419 faces, 1 component (113 small ones removed), 34 small holes closed, "
              "texture 256x512");
    summary.removed_components = 1200, summary.closed_holes = 1;
    EXPECT_EQ(summary_text(summary, mesh, {}),
              "Mesh: 2,419 faces, 1 component (1,200 removed), 1 small hole closed");
}

TEST(Components, SameBytesForAnyNumberOfThreads) {
    const TriangleMesh wall = sheet(0, 0, 0, 3, 60), floating = sheet(-0.5, 0, 2, 1, 40);
    const TriangleMesh sound = joined({wall, ball({0.7, 0.5, 0.4}, 0.3, 20)});
    const TriangleMesh all = joined({sound, floating});
    std::vector<EvidenceView> views = views_of(sound);
    views[0] = view_of(all, kEyes[0]);
    const auto with_threads = [&](int count) {
        const int threads = thread_count();
        set_thread_count(count);
        TriangleMesh mesh = all;
        keep_seen_components(mesh, source_of(views));
        count_views(mesh, source_of(views));
        set_thread_count(threads);
        return mesh;
    };
    const TriangleMesh one = with_threads(1), four = with_threads(4);
    ASSERT_GT(one.faces.size(), wall.faces.size());
    ASSERT_LT(one.faces.size(), all.faces.size());
    ASSERT_EQ(one.vertices.size(), four.vertices.size());
    ASSERT_EQ(one.faces.size(), four.faces.size());
    EXPECT_EQ(
        std::memcmp(one.vertices.data(), four.vertices.data(), one.vertices.size() * sizeof(Vec3f)),
        0);
    EXPECT_EQ(std::memcmp(one.faces.data(), four.faces.data(), one.faces.size() * sizeof(Vec3i)),
              0);
    EXPECT_EQ(one.views, four.views);
}

}  // namespace
}  // namespace tvsgs
