// Tests the compact records of splats in view: the place of each, that splats out of view change no
// bit, and that they need almost no memory.
#include <algorithm>
#include <cstring>

#include "render/backbone.h"
#include "render/tiles/splat_places.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

using test::random_gaussians;
using test::test_camera;

/// Every `nth` splat is in view. Its records hold its index.
struct EveryNth {
    int nth;
    Span<int> shapes, features;
    Span<float> depths;
    Span<TileRect> rects;

    struct Found {
        int i;
    };
    bool find(int i, Found& found) const {
        found.i = i;
        return i % nth == 0;
    }
    float radius(const Found&) const { return 2; }
    void store(int i, const Found& found, std::uint32_t at) const {
        shapes[at] = i, features[at] = found.i + 1, depths[at] = static_cast<float>(i);
        rects[at] = {0, 0, 1, 1};
    }
};

TEST(Places, AreInTheOrderOfTheIndices) {
    PlaceFinder<Cpu> finder;  // of one view after the other: more splats, fewer, none
    ViewSplats<Cpu, int, int> splats;
    Buffer<float, Cpu> radii;
    for (const int count : {70001, 255, 0, 1, 2, 1000, 90000})
        for (const int nth : {3, 1, 100000}) {
            const auto project = [&](auto& to) {
                return EveryNth{nth, to.shapes.span(), to.features.span(), to.depths.span(),
                                to.rects.span()};
            };
            finder.find(count, project, radii, splats);
            const SplatPlaces places = finder.places(radii);
            std::uint32_t next = 0;
            for (int i = 0; i < count; ++i) {
                ASSERT_EQ(places.of(i), i % nth == 0 ? next : kNoPlace) << i << " of " << count;
                if (i % nth != 0) continue;
                ASSERT_EQ(splats.shapes[next], i);
                ASSERT_EQ(splats.features[next], i + 1);
                ASSERT_EQ(splats.depths[next], static_cast<float>(i));
                ASSERT_EQ(splats.rects[next++].count(), 1u);
            }
            EXPECT_EQ(places.in_view(), next);
            EXPECT_EQ(splats.shapes.size(), next);
            EXPECT_LE(finder.room(), static_cast<std::size_t>(count));
        }
}

TEST(PlacesTwin, AreCountedAlike) {
    if (const std::string reason = test::no_cuda(); !reason.empty()) GTEST_SKIP() << reason;
    if constexpr (kHasCuda) {
        Buffer<std::uint32_t, Cuda> before;
        Buffer<std::uint8_t, Cuda> temporary;
        for (const std::size_t count : {70001u, 0u, 1u, 255u, 1000u}) {
            std::vector<float> radii(count);
            for (std::size_t i = 0; i < count; ++i) radii[i] = i % 3 == 0 ? 0.5f : i % 7 ? 0 : -1;
            count_in_view(to_device<Cuda>(radii), before, temporary);
            const auto counted = to_host(before);
            ASSERT_EQ(counted.size(), count + 1);
            for (std::size_t i = 0; i <= count; ++i) ASSERT_EQ(counted[i], (i + 2) / 3) << i;
        }
    }
}

/// Result of a view: all numbers of its images, and those of some splats.
struct Outcome {
    std::vector<std::vector<char>> images, of_splats;

    bool operator==(const Outcome&) const = default;
};

template <class T, class Device>
std::vector<char> bytes_of(const Buffer<T, Device>& buffer) {
    const auto host = to_host(buffer);
    std::vector<char> bytes(host.size() * sizeof(T));
    if (!bytes.empty()) std::memcpy(bytes.data(), host.data(), bytes.size());
    return bytes;
}
template <class T, class Device>
std::vector<char> bytes_of(const Buffer<T, Device>& buffer, const std::vector<std::size_t>& kept) {
    const auto host = to_host(buffer);
    std::vector<char> bytes;
    for (const std::size_t i : kept) {
        const auto* const from = reinterpret_cast<const char*>(&host[i]);
        bytes.insert(bytes.end(), from, from + sizeof(T));
    }
    return bytes;
}

template <class Device>
Outcome view_of(Backbone<Device>& backbone,
                const Gaussians<Device>& g,
                const Camera& camera,
                Maps maps,
                const std::vector<std::size_t>& kept) {
    const auto& images = backbone.forward(g, camera, 3, maps);
    Outcome out;
    out.images = {bytes_of(images.color), bytes_of(images.normal), bytes_of(images.depth),
                  bytes_of(images.transmittance)};
    ImageGradients<Device> by_image;
    const std::vector<Vec3f> ones(images.color.size(), Vec3f{1, 0.5f, 0.2f});
    copy(ones, by_image.color);
    copy(std::vector<float>(images.depth.size(), 0.3f), by_image.depth);
    Gaussians<Device> dL;
    resize(dL, g.size(), g.sh_degree);
    fill_zero(dL);
    backbone.backward(g, by_image, dL);
    const ScreenStatistics<Device>& s = backbone.statistics();
    out.of_splats = {bytes_of(dL.means, kept),          bytes_of(dL.log_scales, kept),
                     bytes_of(dL.quats, kept),          bytes_of(dL.opacity_logits, kept),
                     bytes_of(s.radii_px, kept),        bytes_of(s.dL_dmeans2d, kept),
                     bytes_of(s.abs_dL_dmeans2d, kept), bytes_of(s.front_pixels, kept)};
    std::vector<std::size_t> of_harmonics;
    for (int k = 0; k < sh_count(g.sh_degree); ++k)
        for (const std::size_t i : kept)
            of_harmonics.push_back(static_cast<std::size_t>(k) * g.means.size() + i);
    out.of_splats.push_back(bytes_of(dL.sh, of_harmonics));
    return out;
}

/// The splats of `g` with two splats behind the camera before each one.
Gaussians<Cpu> among_unseen(const Gaussians<Cpu>& g, std::vector<std::size_t>& kept) {
    const std::size_t n = g.means.size();
    Gaussians<Cpu> all;
    resize(all, static_cast<int>(3 * n), g.sh_degree);
    kept.clear();
    for (std::size_t i = 0; i < 3 * n; ++i) {
        const std::size_t from = i / 3;
        for_each_array(
            [&](const SplatArray& array, const auto& values, auto& to) {
                for (std::size_t k = 0; k < static_cast<std::size_t>(array.planes); ++k)
                    if (!values.empty()) to[k * 3 * n + i] = values[k * n + from];
            },
            g, all);
        if (i % 3 == 2)
            kept.push_back(i);
        else
            all.means[i] = {0, 0, -1000};
    }
    return all;
}

struct Drawn {
    const char* name;
    Maps maps;
};
std::vector<Drawn> all_drawn() {
    const Maps all = Maps::color | kGeometryMaps;
    return {{"ewa", Maps::color},  {"ewa", all},    {"ewa", kGeometryMaps}, {"rade", all},
            {"rade", Maps::color}, {"surfel", all}, {"surfel", Maps::color}};
}

template <class Device>
void expect_the_unseen_change_nothing() {
    const Gaussians<Cpu> host = random_gaussians(400, 5, 0.1);
    const Camera camera = test_camera(70, 50, 0);
    std::vector<std::size_t> all, kept;
    for (std::size_t i = 0; i < host.means.size(); ++i) all.push_back(i);
    const Gaussians<Cpu> more = among_unseen(host, kept);
    Gaussians<Device> few, many;
    copy(host, few), copy(more, many);
    for (const Drawn& drawn : all_drawn()) {
        const auto a = make_backbone<Device>(drawn.name, {}),
                   b = make_backbone<Device>(drawn.name, {});
        EXPECT_TRUE(view_of(*a, few, camera, drawn.maps, all) ==
                    view_of(*b, many, camera, drawn.maps, kept))
            << drawn.name;
        EXPECT_GT(b->counts().visible, 100) << drawn.name;
    }
}

TEST(Places, WhatIsOutOfViewChangesNoBit) {
    expect_the_unseen_change_nothing<Cpu>();
}

/// From a view of few splats to views of more, which do not fit at first, and back.
template <class Device>
void expect_views_as_if_alone() {
    const Gaussians<Cpu> host = random_gaussians(600, 6, 0.1);
    Gaussians<Device> g;
    copy(host, g);
    std::vector<std::size_t> all;
    for (std::size_t i = 0; i < host.means.size(); ++i) all.push_back(i);
    std::vector<Camera> cameras;
    for (const float aside : {30.0f, 2.2f, 1.7f, 0.0f, 2.0f, 30.0f, 0.0f}) {
        cameras.push_back(test_camera(70, 50, 0));
        cameras.back().camera_from_world.t.x += aside;
    }
    for (const Drawn& drawn : all_drawn()) {
        const auto one = make_backbone<Device>(drawn.name, {});
        std::vector<int> visible;
        for (const Camera& camera : cameras) {
            const auto alone = make_backbone<Device>(drawn.name, {});
            EXPECT_TRUE(view_of(*one, g, camera, drawn.maps, all) ==
                        view_of(*alone, g, camera, drawn.maps, all))
                << drawn.name;
            visible.push_back(one->counts().visible);
            EXPECT_EQ(alone->counts().visible, visible.back());
        }
        EXPECT_EQ(visible[0], 0);
        EXPECT_GT(visible[1], 0);
        EXPECT_GT(visible[2], visible[1] + visible[1] / 16 + 1) << "more than there is room for";
        EXPECT_GT(visible[3], visible[2] + visible[2] / 16 + 1);
    }
}

TEST(Places, OneViewLeavesNothingToTheNext) {
    expect_views_as_if_alone<Cpu>();
}

TEST(PlacesTwin, OnAGpuAsWell) {
    if (const std::string reason = test::no_cuda(); !reason.empty()) GTEST_SKIP() << reason;
    if constexpr (kHasCuda) {
        expect_the_unseen_change_nothing<Cuda>();
        expect_views_as_if_alone<Cuda>();
    }
}

}  // namespace
}  // namespace tvsgs
