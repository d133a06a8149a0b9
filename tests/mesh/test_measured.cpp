// Tests which surface photographs confirm.
#include <gtest/gtest.h>

#include <cmath>

#include "core/device/threads.h"
#include "mesh/evidence_scenes.h"
#include "mesh/mend/mend.h"

namespace tvsgs {
namespace {

using namespace test;

/// Grey value at a point of a surface, 0 to 255.
using Paint = std::function<double(Vec3d)>;

/// A texture with a wavelength of six pixels, for surfaces five units away.
double texture(Vec3d p) {
    return 128 + 40 * std::sin(40 * p.x + 3 * std::sin(7 * p.y)) +
           40 * std::sin(37 * p.y + 2 * std::sin(11 * p.z)) + 40 * std::sin(43 * p.z + p.x);
}

/// The photograph of a scene whose surface looks like `paint`, as the plane z = 0 behind it.
View photo_of(const EvidenceView& evidence, const Paint& paint) {
    View view;
    const Camera& c = view.camera = evidence.camera;
    view.photo = ImageU8(c.width_px, c.height_px, 3);
    const Rigid3f world_from_camera = inverse(c.camera_from_world);
    for (int y = 0, i = 0; y < c.height_px; ++y)
        for (int x = 0; x < c.width_px; ++x, ++i) {
            const float depth = evidence.depth[static_cast<std::size_t>(i)];
            const Vec3f eye = world_from_camera.t, ray = world_from_camera.R * pixel_ray(c, x, y);
            const Vec3f p = eye + (depth > 0 ? depth : -eye.z / ray.z) * ray;
            for (int k = 0; k < 3; ++k)
                view.photo.at(x, y, k) = static_cast<std::uint8_t>(
                    std::lround(std::clamp(paint(vec_cast<double>(p)), 0.0, 255.0)));
        }
    return view;
}

/// A scene as each view sees it. paint(i): as view i shows it.
struct Photographed {
    std::vector<EvidenceView> evidence;
    std::vector<View> views;

    Photographed(std::vector<EvidenceView> maps, const std::function<Paint(int)>& paint)
        : evidence(std::move(maps)) {
        for (std::size_t i = 0; i < evidence.size(); ++i)
            views.push_back(photo_of(evidence[i], paint(static_cast<int>(i))));
    }
    MeasuredReport keep(TriangleMesh& mesh, float share = 0.5f) const {
        return keep_measured_faces(mesh, source_of(evidence), views, share);
    }
};

/// Noise of a view, with cells of about a pixel.
Paint noise(int view) {
    return [view](Vec3d p) {
        const double wave = std::sin(127.1 * std::floor(35 * p.x) + 311.7 * std::floor(35 * p.y) +
                                     74.7 * std::floor(35 * p.z) + 53.3 * view) *
                            43758.5453;
        return 255 * (wave - std::floor(wave));
    };
}

/// A wall that all of kEyes see as a whole, with edges of a pixel.
TriangleMesh wall() {
    return sheet(0, 0, 0, 2, 80);
}

/// `count` views of the wall. With three, noise agrees by chance in a quarter of the places.
std::vector<EvidenceView> many_views(int count) {
    std::vector<EvidenceView> views;
    for (int i = 0; i < count; ++i)
        views.push_back(view_of(wall(), {-1.2 + 2.4 * i / (count - 1), i % 2 ? 0.3 : -0.3, 5}));
    return views;
}

TEST(Measured, KeepsAllThatOneSideShows) {
    const TriangleMesh scene = joined({wall(), sheet(0, 0, 0.5, 0.5, 20)});
    const Photographed photos(views_of(scene), [](int) { return Paint(texture); });
    TriangleMesh mesh = scene;
    const MeasuredReport report = photos.keep(mesh);
    // A view hides a strip of the wall behind the sheet; surface around it is measured.
    EXPECT_LT(report.removed_area, 0.01);
    EXPECT_GT(area(mesh), 0.99 * area(scene));
}

TEST(Measured, RemovesWhatViewsShowDifferently) {
    const Photographed photos(many_views(6), noise);
    TriangleMesh mesh = wall();
    const MeasuredReport report = photos.keep(mesh);
    EXPECT_LT(area(mesh), 0.03 * area(wall()));  // noise agrees by chance
    EXPECT_EQ(report.removed_faces, wall().faces.size() - mesh.faces.size());
    EXPECT_NEAR(report.removed_area, 1 - area(mesh) / area(wall()), 1e-6);
}

TEST(Measured, AGradientOfTheSkyIsNoTexture) {
    // It depends on the direction; with noise of a grey level or two.
    const Photographed photos(views_of(wall()), [](int i) {
        return Paint([i, eye = kEyes[i]](Vec3d p) {
            const Vec3d d = (1 / (p - eye).z) * (p - eye);
            return 130 + 147 * d.x + 93 * d.y + 0.01 * noise(i)(p);
        });
    });
    TriangleMesh mesh = wall();
    photos.keep(mesh);
    EXPECT_LT(area(mesh), 0.05 * area(wall()));
}

TEST(Measured, CutsBetweenMeasuredAndOther) {
    const Photographed photos(many_views(6), [](int i) {
        return Paint([i](Vec3d p) { return p.x < 0 ? texture(p) : noise(i)(p); });
    });
    TriangleMesh mesh = wall();
    photos.keep(mesh);
    double left = 0, right = 0;
    for (const Vec3f p : mesh.vertices) {
        EXPECT_LT(p.x, 0.325) << "13 pixels beyond the texture";
        left += p.x < 0, right += p.x >= 0;
    }
    EXPECT_GT(left, 0.9 * 0.5 * static_cast<double>(wall().vertices.size()));
    EXPECT_GT(left, 4.5 * right);
}

// Beside a strip that one view alone has a depth of, seven edges wide.
TEST(Measured, AStripThatOneViewSeesStays) {
    Photographed photos(many_views(3), [](int) { return Paint(texture); });
    for (const int i : {0, 2}) {
        EvidenceView& view = photos.evidence[i];
        const Camera& c = view.camera;
        const Rigid3f world_from_camera = inverse(c.camera_from_world);
        for (int y = 0, k = 0; y < c.height_px; ++y)
            for (int x = 0; x < c.width_px; ++x, ++k) {
                const Vec3f p = world_from_camera.t +
                                view.depth[k] * (world_from_camera.R * pixel_ray(c, x, y));
                if (p.x > 0.82f) view.depth[k] = 0;
            }
    }
    TriangleMesh mesh = wall();
    photos.keep(mesh);
    EXPECT_GT(area(mesh), 0.99 * area(wall()));
}

TEST(Measured, PlainSurfaceStaysWhereHalfOfTheViewsEncloseIt) {
    // Texture with a plain part in the middle; in `open` of eight views the part ends at the edge
    // of the wall, as a sky does.
    const auto kept = [](int open) {
        const Photographed photos(many_views(8), [open](int i) {
            return Paint([=](Vec3d p) {
                const bool plain = std::fabs(p.x) < 0.6 && p.y > -0.6 && (p.y < 0.6 || i < open);
                return plain ? 128 : texture(p);
            });
        });
        TriangleMesh mesh = wall();
        photos.keep(mesh);
        return area(mesh) / area(wall());
    };
    EXPECT_EQ(kept(0), 1);
    EXPECT_EQ(kept(2), 1);
    EXPECT_LT(kept(6), 0.8);
    EXPECT_LT(kept(8), 0.75);  // 0.52 without any plain surface
    EXPECT_GT(kept(8), 0.5);
}

TEST(Measured, HalfOfTheViewsHaveToAgree) {
    const auto kept = [](int agree) {
        TriangleMesh mesh = wall();
        Photographed(many_views(8), [agree](int i) {
            return i < agree ? Paint(texture) : noise(i);
        }).keep(mesh);
        return area(mesh) / area(wall());
    };
    EXPECT_GT(kept(4), 0.5);
    EXPECT_LT(kept(2), 0.25);
}

/// Eight cameras around a ball, and a dome far behind that renders show and photographs do not.
TEST(Measured, KeepsTheObjectOfARing) {
    const TriangleMesh object = ball({0, 0, 0}, 0.8, 50);
    TriangleMesh dome = ball({0, 0, 0}, 9, 40);
    for (Vec3i& face : dome.faces) std::swap(face.y, face.z);
    const TriangleMesh scene = joined({object, dome});
    std::vector<EvidenceView> maps;
    for (int i = 0; i < 8; ++i)
        maps.push_back(view_of(
            scene, {5 * std::cos(0.785398 * i), 5 * std::sin(0.785398 * i), i % 2 ? 1.5 : -1.5}));
    const Photographed photos(maps, [](int i) {
        return Paint([i](Vec3d p) { return norm(p) < 1 ? texture(p) : noise(i)(0.3 * p); });
    });
    TriangleMesh mesh = scene;
    photos.keep(mesh);
    double kept = 0, far = 0;
    for (const Vec3f p : mesh.vertices) norm(p) < 1 ? ++kept : ++far;
    EXPECT_GT(kept, 0.95 * static_cast<double>(object.vertices.size()));
    EXPECT_EQ(area(mesh) > 1.05 * area(object), false) << far << " vertices of the dome";
}

TEST(Measured, NothingToCompare) {
    Photographed photos(views_of(wall()), noise);
    photos.views[0].photo = {}, photos.views[2].photo = {};
    TriangleMesh mesh = wall();
    EXPECT_EQ(photos.keep(mesh).removed_faces, 0u);
    EXPECT_EQ(mesh.faces.size(), wall().faces.size());
    TriangleMesh none;
    EXPECT_EQ(photos.keep(none).removed_faces, 0u);
}

TEST(Measured, TheSameForAnyNumberOfThreads) {
    const Photographed photos(views_of(wall()), [](int i) {
        return Paint([i](Vec3d p) { return p.x * p.y < 0 ? texture(p) : noise(i)(p); });
    });
    std::vector<TriangleMesh> meshes;
    const int before = thread_count();
    for (const int threads : {1, 3}) {
        set_thread_count(threads);
        photos.keep(meshes.emplace_back(wall()));
    }
    set_thread_count(before);
    ASSERT_EQ(meshes[0].faces.size(), meshes[1].faces.size());
    for (std::size_t f = 0; f < meshes[0].faces.size(); ++f)
        for (int k = 0; k < 3; ++k) EXPECT_EQ(meshes[0].faces[f][k], meshes[1].faces[f][k]);
}

}  // namespace
}  // namespace tvsgs
