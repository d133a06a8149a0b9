// The loss on descriptors: compared with its definition in double, and minimal at the depth of a
// textured plane.
#include <map>
#include <numbers>

#include "fates_case.h"
#include "mvs/stereo/descriptors.h"
#include "optim/losses/feature_math.h"

namespace tvsgs {
namespace {

using test::central_difference;
using test::close;
using test::evaluate;
using test::FatesCase;
using test::FatesResult;
using test::FatesView;
using Vec2d = Vec2<double>;

constexpr float kWeight = 0.8f;

Vec3d ray_d(const Camera& c, double x, double y) {
    return {(x - c.cx_px) / c.fx_px, (y - c.cy_px) / c.fy_px, 1};
}

/// The plane n . X = 0.1 in the world, facing the cameras.
const Vec3d kNormal = normalize(Vec3d{0.3, -0.2, -1});

/// z of the plane at a point of the image (corner coordinates), times `scale`.
double plane_depth(const Camera& c, double x, double y) {
    const auto R = mat_cast<double>(c.camera_from_world.R);
    const Vec3d centre = -transpose_times(R, vec_cast<double>(c.camera_from_world.t));
    return (0.1 - dot(kNormal, centre)) / dot(R * kNormal, ray_d(c, x, y));
}

Vec3d plane_point(const Camera& c, double x, double y) {
    const auto R = mat_cast<double>(c.camera_from_world.R);
    const Vec3d p = plane_depth(c, x, y) * ray_d(c, x, y) - vec_cast<double>(c.camera_from_world.t);
    return transpose_times(R, p);
}

/// Descriptors as a function of the point on the plane, with noise.
ViewMap plane_features(
    const Camera& c, std::string_view name, int width, int height, double noise, unsigned seed) {
    test::Random random(seed);
    constexpr int kChannels = 6;
    ViewMap map{std::string(name), width, height, kChannels, {}};
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            const Vec3d p =
                plane_point(c, (x + 0.5) * c.width_px / width, (y + 0.5) * c.height_px / height);
            for (int k = 0; k < kChannels; ++k)
                map.values.push_back(static_cast<float>(std::sin((2 + 0.4 * k) * p.x + k) +
                                                        std::cos((3 - 0.3 * k) * p.y - k) +
                                                        noise * random.normal()));
        }
    return map;
}

FatesView plane_view(float angle, int width, int height, unsigned seed, double noise) {
    FatesView v;
    v.camera = test::test_camera(width, height, angle);
    v.maps.push_back(plane_features(v.camera, prior_map::kFeatures, 24, 20, noise, seed));
    v.maps.push_back(plane_features(v.camera, prior_map::kCoarseFeatures, 13, 9, noise, seed + 50));
    return v;
}

void set_depth(FatesCase& c, double scale, double noise = 0) {
    test::Random random(77);
    const Camera& camera = c.view.camera;
    c.depth.clear();
    for (int y = 0; y < camera.height_px; ++y)
        for (int x = 0; x < camera.width_px; ++x)
            c.depth.push_back(static_cast<float>(scale * plane_depth(camera, x + 0.5, y + 0.5) *
                                                 (1 + noise * random.normal())));
    c.transmittance.assign(c.depth.size(), 0);
}

/// Two neighbour views of different sizes; depths and descriptors have some noise.
FatesCase plane_case() {
    FatesCase c;
    c.view = plane_view(0, 40, 30, 1, 0.2);
    c.others = {plane_view(0.25f, 36, 28, 2, 0.2), plane_view(-0.3f, 40, 30, 3, 0.2)};
    set_depth(c, 1, 0.01);
    for (std::size_t i = 0; i < c.depth.size(); i += 37) c.depth[i] = 0;
    for (std::size_t i = 5; i < c.depth.size(); i += 11) c.transmittance[i] = 0.51f;
    c.options.photometric.weight = 0;
    c.options.features.weight = kWeight;
    return c;
}

/// A block in front of the plane, in the middle.
FatesCase occluded_case() {
    FatesCase c = plane_case();
    for (int y = 10; y < 20; ++y)
        for (int x = 15; x < 25; ++x) c.depth[static_cast<std::size_t>(40 * y + x)] = 2.8f;
    return c;
}

const ViewMap* find_map(const FatesView& v, std::string_view name) {
    for (const ViewMap& map : v.maps)
        if (map.name == name) return &map;
    return nullptr;
}

FeatureMap feature_map(const ViewMap& m) {
    return {m.values.data(), m.width_px, m.height_px, m.channels};
}

/// One compared pair of a pixel, and its cost as a function of depth.
struct Sample {
    ViewPair<double> pair;
    Vec3d ray;
    FeatureMap here, there;
    Vec2d point, scale;
    double weight;

    double cost(double depth) const {
        const auto seen = seen_point(pair, ray, depth);
        return weight * feature_match(here, point, there,
                                      {scale.x * seen.point.x, scale.y * seen.point.y}, 3.0)
                            .error;
    }
};

/// Whether each pixel is the nearest in its pixel of the other view.
std::vector<bool> visible(const FatesCase& c, const FatesView& other) {
    const Camera& camera = c.view.camera;
    const auto pair = view_pair(camera, other.camera, c.min_depth);
    std::map<std::pair<int, int>, std::pair<float, std::size_t>> nearest;
    std::vector<bool> result(c.depth.size(), false);
    for (std::size_t i = 0; i < c.depth.size(); ++i) {
        const int at = static_cast<int>(i);
        const auto seen = seen_point(
            pair, pixel_ray(camera, at % camera.width_px, at / camera.width_px), c.depth[i]);
        if (!seen.inside) continue;
        const std::pair cell{static_cast<int>(seen.point.x), static_cast<int>(seen.point.y)};
        const float distance = norm(seen.there);
        const auto found = nearest.find(cell);
        if (found == nearest.end() || distance < found->second.first) nearest[cell] = {distance, i};
    }
    for (const auto& [cell, winner] : nearest) result[winner.second] = true;
    return result;
}

/// All compared pairs, per pixel.
std::vector<std::vector<Sample>> samples_of(const FatesCase& c) {
    std::vector<std::vector<Sample>> samples(c.depth.size());
    const Camera& camera = c.view.camera;
    double with_depth = 0;
    for (const float d : c.depth) with_depth += d > 0;
    double comparable = 0;
    for (const FatesView& other : c.others)
        comparable += find_map(other, prior_map::kFeatures) != nullptr;
    for (const FatesView& other : c.others) {
        if (!find_map(other, prior_map::kFeatures)) continue;
        const std::vector<bool> seen = visible(c, other);
        const bool both = find_map(c.view, prior_map::kCoarseFeatures) &&
                          find_map(other, prior_map::kCoarseFeatures);
        for (const bool coarse : {false, true}) {
            if (coarse && !both) continue;
            const auto name = coarse ? prior_map::kCoarseFeatures : prior_map::kFeatures;
            const FeatureMap here = feature_map(*find_map(c.view, name)),
                             there = feature_map(*find_map(other, name));
            const double share = coarse ? 0.5 / 1.5 : both ? 1 / 1.5 : 1;
            for (std::size_t i = 0; i < c.depth.size(); ++i) {
                if (!(c.depth[i] > 0) || c.transmittance[i] > 0.5f || !seen[i]) continue;
                const double x = static_cast<double>(i %
                                                     static_cast<std::size_t>(camera.width_px)) +
                                 0.5,
                             y = static_cast<double>(i /
                                                     static_cast<std::size_t>(camera.width_px)) +
                                 0.5;
                const Sample s{
                    view_pair<double>(camera, other.camera, c.min_depth),
                    ray_d(camera, x, y),
                    here,
                    there,
                    {x * here.width / camera.width_px, y * here.height / camera.height_px},
                    {static_cast<double>(there.width) / other.camera.width_px,
                     static_cast<double>(there.height) / other.camera.height_px},
                    kWeight * share / comparable / with_depth};
                const auto at = seen_point(s.pair, s.ray, static_cast<double>(c.depth[i]));
                if (at.inside && feature_match(here, s.point, there,
                                               {s.scale.x * at.point.x, s.scale.y * at.point.y},
                                               double{FeatureBody::kMaxError})
                                     .valid)
                    samples[i].push_back(s);
            }
        }
    }
    return samples;
}

void expect_sum_and_slopes(const FatesCase& c) {
    const FatesResult r = evaluate<Cpu>(c);
    const auto samples = samples_of(c);
    double sum = 0;
    int checked = 0;
    for (std::size_t i = 0; i < samples.size(); ++i) {
        const auto around = [&](double h) {
            double cost = 0;
            for (const Sample& s : samples[i]) cost += s.cost(static_cast<double>(c.depth[i]) + h);
            return cost;
        };
        sum += around(0);
        if (samples[i].empty()) {
            ASSERT_EQ(r.dL_ddepth[i], 0) << i;
            continue;
        }
        const double expected = central_difference(around, 1e-5);
        // At the edge of a cell.
        if (std::abs(expected - central_difference(around, 3e-6)) > 1e-7) continue;
        ++checked;
        // Tolerance: rounding of the 3 that was there before, and of the sums in a cosine.
        ASSERT_NEAR(r.dL_ddepth[i], expected, 2e-6) << i;
    }
    EXPECT_TRUE(close(r.value, sum, 1e-4));
    EXPECT_GT(r.value, 0.003);
    EXPECT_GT(checked, 500);
}

TEST(FeatureLoss, ValueAndGradient) {
    expect_sum_and_slopes(plane_case());
}

TEST(FeatureLoss, OneResolutionAloneCountsFully) {
    FatesCase c = plane_case();
    c.others[0].maps.pop_back();  // only of this pair
    expect_sum_and_slopes(c);
    c.view.maps.pop_back();
    expect_sum_and_slopes(c);
    // A view without descriptors is not compared, and does not count in the mean.
    c.others[1].maps.clear();
    expect_sum_and_slopes(c);
}

TEST(FeatureLoss, WhatABlockHidesDoesNotCount) {
    const FatesCase c = occluded_case();
    expect_sum_and_slopes(c);
    // Points of the plane that the block hides from the other view, found by geometry: the ray from
    // the other camera meets the block first.
    const Camera& a = c.view.camera;
    int hidden = 0, removed = 0;
    FatesCase one = c, open = plane_case();  // without the block
    one.others.resize(1), open.others.resize(1);
    const FatesResult behind = evaluate<Cpu>(one), seen = evaluate<Cpu>(open);
    const auto pair = view_pair<double>(a, c.others[0].camera, 0.1);
    for (int y = 0; y < 30; ++y)
        for (int x = 0; x < 40; ++x) {
            const auto i = static_cast<std::size_t>(40 * y + x);
            if (!(c.depth[i] > 2.9f)) continue;
            const Vec3d there =
                pair.other_from_reference * (double{c.depth[i]} * ray_d(a, x + 0.5, y + 0.5));
            // The ray to the other camera at the block's depth of 2.8 in the reference.
            const Vec3d back = transpose_times(pair.other_from_reference.R,
                                               there - pair.other_from_reference.t),
                        eye = transpose_times(pair.other_from_reference.R,
                                              -pair.other_from_reference.t);
            const double t = (2.8 - eye.z) / (back.z - eye.z);
            const Vec3d p = eye + t * (back - eye);
            const double u = a.fx_px * p.x / p.z + a.cx_px, v = a.fy_px * p.y / p.z + a.cy_px;
            // Well inside the block: its points there fill pixels of the other view.
            if (!(t > 0 && t < 1 && u > 15.5 && u < 24.5 && v > 10.5 && v < 19.5)) continue;
            if (seen.dL_ddepth[i] == 0) continue;
            ++hidden;
            removed += behind.dL_ddepth[i] == 0;
        }
    EXPECT_GT(hidden, 20);
    EXPECT_GT(removed, 0.9 * hidden);
}

TEST(FeatureLoss, OfEquallyNearPointsOneIsSeen) {
    FatesCase c;
    c.view.camera = {8, 8, 8, 8, 4, 4, {}};
    const auto map = [](std::vector<float> of_pixel) {
        std::vector<float> values;
        for (int i = 0; i < 4; ++i) values.insert(values.end(), of_pixel.begin(), of_pixel.end());
        return ViewMap{std::string(prior_map::kFeatures), 2, 2, 2, values};
    };
    c.view.maps = {map({1, 0})};
    // All points project to its single pixel; the four in the middle are equally near.
    c.others = {{scaled_camera(c.view.camera, 1, 1), {map({0.8f, 0.6f})}}};  // a cosine of 0.8
    c.depth.assign(64, 2), c.transmittance.assign(64, 0);
    c.options.photometric.weight = 0;
    c.options.features.weight = 1;
    EXPECT_NEAR(evaluate<Cpu>(c).value, 0.2 / 64, 1e-7);
}

/// Derivative of the loss by a factor on all depths, at `scale`.
double depth_slope(FatesCase& c, double scale) {
    set_depth(c, scale);
    const FatesResult r = evaluate<Cpu>(c);
    double slope = 0;
    for (std::size_t i = 0; i < c.depth.size(); ++i)
        slope += double{r.dL_ddepth[i]} * double{c.depth[i]} / scale;
    return slope;
}

TEST(FeatureLoss, IsLeastWhereThePlaneIs) {
    FatesCase c = plane_case();
    c.view = plane_view(0, 40, 30, 1, 0);
    c.others = {plane_view(0.25f, 40, 30, 2, 0)};
    const auto slope_at = [&](double scale) { return depth_slope(c, scale); };
    // Change of the depth scale that moves the projection by a tenth of a pixel.
    const auto pair = view_pair<double>(c.view.camera, c.others[0].camera, 0.1);
    const Vec3d ray = ray_d(c.view.camera, 20, 15);
    const double z = plane_depth(c.view.camera, 20, 15);
    const Vec2d moved = seen_point(pair, ray, 1.01 * z).point - seen_point(pair, ray, z).point;
    const double tenth = 0.1 / (100 * std::sqrt(dot(moved, moved)));
    EXPECT_LT(slope_at(1 - tenth), 0);
    EXPECT_GT(slope_at(1 + tenth), 0);
    EXPECT_LT(slope_at(1 - 8 * tenth), 0);
    EXPECT_GT(slope_at(1 + 8 * tenth), 0);
}

/// A photograph of a texture on the plane.
ImageU8 plane_photo(const Camera& c) {
    ImageU8 photo(c.width_px, c.height_px, 3);
    for (int y = 0; y < c.height_px; ++y)
        for (int x = 0; x < c.width_px; ++x) {
            const Vec3d p = plane_point(c, x + 0.5, y + 0.5);
            const double grey = 128 + 50 * std::sin(9 * p.x + 2 * p.y) +
                                40 * std::sin(11 * p.y - 3 * p.x) +
                                30 * std::sin(5 * p.x * p.y + 4 * p.x);
            for (int k = 0; k < 3; ++k)
                photo.at(x, y, k) = static_cast<std::uint8_t>(std::clamp(grey, 0.0, 255.0));
        }
    return photo;
}

TEST(FeatureLoss, OurDescriptorsFindThePlane) {
    FatesCase c;
    c.options.photometric.weight = 0;
    c.options.features.weight = 1;
    std::vector<View> views(2);
    for (std::size_t v = 0; v < 2; ++v) {
        views[v].camera = test::test_camera(161, 120, v ? 0.15f : 0.0f);
        views[v].photo = plane_photo(views[v].camera);
    }
    EXPECT_EQ(add_descriptors(views), 2 * 4 * 32 * (81 * 60 + 41 * 30));
    c.view = {views[0].camera, views[0].maps};
    c.others = {{views[1].camera, views[1].maps}};
    const auto slope_at = [&](double scale) { return depth_slope(c, scale); };
    const auto pair = view_pair<double>(c.view.camera, c.others[0].camera, 0.1);
    const Vec3d ray = ray_d(c.view.camera, 80, 60);
    const double z = plane_depth(c.view.camera, 80, 60);
    const Vec2d moved = seen_point(pair, ray, 1.01 * z).point - seen_point(pair, ray, z).point;
    const double pixel = 1 / (100 * std::sqrt(dot(moved, moved)));
    // Descriptors have half the resolution: the steps are tenths of their pixel.
    for (const double off : {0.2, 0.5, 1.0}) {
        EXPECT_LT(slope_at(1 - off * pixel), 0) << off;
        EXPECT_GT(slope_at(1 + off * pixel), 0) << off;
    }
}

void expect_nothing(const FatesCase& c, const char* why) {
    const FatesResult r = evaluate<Cpu>(c);
    EXPECT_EQ(r.value, 0) << why;
    for (const float g : r.dL_ddepth) ASSERT_EQ(g, 0) << why;
}

TEST(FeatureLoss, WhereNothingCanBeComparedItAddsNothing) {
    const FatesCase full = plane_case();
    FatesCase c = full;
    c.others.clear();
    expect_nothing(c, "no other view");
    c = full;
    c.view.maps.clear();
    expect_nothing(c, "no descriptors here");
    c = full;
    for (FatesView& other : c.others) other.maps.clear();
    expect_nothing(c, "no descriptors there");
    c = full;
    for (FatesView& other : c.others) {  // looks away
        Camera& camera = other.camera;
        const Mat3f turn = rotation(Quatf{0, 0, 1, 0});
        camera.camera_from_world.R = turn * camera.camera_from_world.R;
        camera.camera_from_world.t = turn * camera.camera_from_world.t;
    }
    expect_nothing(c, "no overlap");
    c = full;
    for (FatesView& other : c.others) other.camera.cx_px += 500;
    expect_nothing(c, "beside the image");
    c = full;
    c.min_depth = 100;
    expect_nothing(c, "too near to the other view");
    c = full;
    c.depth.assign(c.depth.size(), 0);
    expect_nothing(c, "no depth");
    c.depth.assign(c.depth.size(), NAN);
    expect_nothing(c, "not a number");
    c = full;
    c.transmittance.assign(c.depth.size(), 0.6f);
    expect_nothing(c, "hardly covered");
    c = full;
    for (ViewMap& map : c.view.maps) std::fill(map.values.begin(), map.values.end(), 0.0f);
    expect_nothing(c, "descriptors of nothing");
    c = full;  // descriptors of something else: a few are similar by chance
    for (ViewMap& map : c.view.maps)
        for (float& value : map.values) value = -value;
    EXPECT_LT(evaluate<Cpu>(c).value, 0.05 * evaluate<Cpu>(full).value);
}

TEST(FeatureLoss, DescriptorsOfDifferentKindsAreRefused) {
    FatesCase c = plane_case();
    c.others[1].maps[0].channels = 3;
    c.others[1].maps[0].values.resize(24 * 20 * 3);
    try {
        evaluate<Cpu>(c);
        ADD_FAILURE() << "it compares 6 numbers with 3";
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::input);
        EXPECT_NE(std::string(error.what()).find("features"), std::string::npos) << error.what();
    }
}

TEST(FatesTwins, Features) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda)
        for (const FatesCase& c : {plane_case(), occluded_case()}) {
            const FatesResult a = evaluate<Cpu>(c), b = test::evaluate_cuda(c),
                              again = test::evaluate_cuda(c);
            // Rounding may change which pixel is nearest, or whether an error exceeds the limit.
            EXPECT_TRUE(close(a.value, b.value, 5e-3));
            EXPECT_EQ(b.value, again.value);
            int differ = 0;
            for (std::size_t i = 0; i < a.dL_ddepth.size(); ++i) {
                differ += std::abs(a.dL_ddepth[i] - b.dL_ddepth[i]) > 3e-6f;
                ASSERT_EQ(b.dL_ddepth[i], again.dL_ddepth[i]) << i;
            }
            EXPECT_LT(differ, 12);
        }
}

}  // namespace
}  // namespace tvsgs
