// Tests the estimate of pose errors: known motions, noise, lenses, and unusual files.
#include <gtest/gtest.h>

#include <cmath>

#include "io/scene/load_views.h"
#include "render/tiles/camera_math.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

constexpr int kPoints = 400;

/// A view at the origin that looks along z, points in front of it, and their observations.
struct Model {
    ColmapImage image;
    ColmapPoints points;
    Intrinsics in;

    Model(Vec3d turn, Vec3d shift, double noise_px, const Distortion& distortion = {}) {
        in.width_px = 400, in.height_px = 300;
        in.fx_px = 380, in.fy_px = 370, in.cx_px = 205, in.cy_px = 148;
        in.distortion = distortion;
        image.id = 7;
        image.camera_from_world = rigid_exp(turn, shift);
        test::Random random(1);
        for (int i = 0; i < kPoints; ++i) {
            const double z = random.uniform(3, 6);
            const Vec3d p{z * random.uniform(-0.4, 0.4), z * random.uniform(-0.3, 0.3), z};
            Vec2<double> place;
            find_in_photo(in, in.fx_px * p.x / z + in.cx_px, in.fy_px * p.y / z + in.cy_px, place);
            points.positions.push_back(p);
            points.track.push_back(7), points.track_observation.push_back(U(i));
            points.track_begin.push_back(points.track.size());
            image.observations.push_back(
                {static_cast<float>(place.x + noise_px * random.normal()),
                 static_cast<float>(place.y + noise_px * random.normal())});
        }
    }
    /// Reduced to half the photograph's size.
    double error() const {
        std::vector<View> views(1);
        views[0].camera.width_px = 200;
        ViewSource source;
        source.image = &image, source.intrinsics = in;
        measure_pose_errors(points, {source}, views);
        return views[0].pose_error_px;
    }

private:
    static std::uint32_t U(int i) { return static_cast<std::uint32_t>(i); }
};

TEST(PoseError, NoneWhereThePoseFits) {
    EXPECT_LT(Model({}, {}, 0).error(), 1e-4);
    Distortion lens;
    lens.kind = Distortion::Kind::radial;
    lens.k[0] = -0.1, lens.p1 = 0.002;
    EXPECT_LT(Model({}, {}, 0, lens).error(), 1e-4);
}

TEST(PoseError, OfAKnownMotion) {
    // A rotation shifts the image by about f x angle, a shift by f x shift / depth; halved.
    EXPECT_NEAR(Model({0, 0.01, 0}, {}, 0).error(), 0.5 * 380 * 0.01, 0.15);
    EXPECT_NEAR(Model({}, {0, 0.04, 0}, 0).error(), 0.5 * 370 * 0.04 / 4.3, 0.15);
}

TEST(PoseError, InfiniteWithThePointsBehindTheCamera) {
    Model model({}, {}, 0);
    model.image.camera_from_world.t.z = -5.9;
    EXPECT_TRUE(std::isinf(model.error()));
}

TEST(PoseError, InfiniteWithMirroredPoints) {
    Model model({}, {}, 0);
    for (Vec3d& p : model.points.positions) p.x = -p.x;
    EXPECT_TRUE(std::isinf(model.error()));
}

TEST(PoseError, NoiseOfObservationsIsNone) {
    EXPECT_LT(Model({}, {}, 1).error(), 0.08);
    EXPECT_NEAR(Model({0, 0.01, 0}, {}, 1).error(), 1.9, 0.2);
}

TEST(PoseError, WrongMatchesDoNotCount) {
    Model model({0, 0.01, 0}, {}, 0.3);
    for (std::size_t i = 0; i < 40; ++i)
        model.image.observations[10 * i] = {5, static_cast<float>(7 * i)};
    EXPECT_NEAR(model.error(), 1.9, 0.2);
}

TEST(PoseError, UnknownWhereLittleIsThere) {
    Model few({0, 0.01, 0}, {}, 0);
    few.image.observations.resize(20);
    EXPECT_TRUE(std::isnan(few.error()));
    Model none({}, {}, 0);
    none.image.observations.clear();
    EXPECT_TRUE(std::isnan(none.error()));
    Model broken({}, {}, 0);
    for (auto& o : broken.image.observations) o.x = NAN;
    EXPECT_TRUE(std::isnan(broken.error()));
    Model one_place({0, 0.01, 0}, {}, 0);  // one point, seen often: still a number
    for (std::size_t i = 1; i < kPoints; ++i) {
        one_place.points.positions[i] = one_place.points.positions[0];
        one_place.image.observations[i] = one_place.image.observations[0];
    }
    EXPECT_TRUE(std::isfinite(one_place.error()));
}

}  // namespace
}  // namespace tvsgs
