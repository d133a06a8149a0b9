// The plan: settings that change by degrees with the cloud and the number of views.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "plan/decide.h"
#include "plan_scene.h"

namespace tvsgs {
namespace {

using namespace test;

/// Settings that depend on the points per pixel of the cloud.
Settings by_cloud(double points_per_pixel,
                  int views = 3,
                  const std::function<void(TrainingInputs&)>& change = {},
                  double in_pairs = 1,
                  double angle_deg = 0) {
    SceneLook look;
    look.train_views = views, look.points = 1000, look.pixels = 8000;
    look.points_per_pixel = points_per_pixel;
    look.views_in_pairs = look.views_in_wide_pairs = in_pairs;
    look.views_in_widest_pairs = angle_deg > 0 ? 1 : in_pairs;
    look.pair_angle_deg = angle_deg;
    TrainingInputs in;
    in.configured = in.options.iterations = 15000, in.normals = true;
    in.options.tv.vote_every = 10, in.options.tv.refresh_every = 100;
    in.options.loss.tv_position.weight = 1, in.options.densify.until = 15000;
    in.multi_view.multi_view_geometry.weight = 0.03f, in.multi_view.multi_view_ncc.weight = 0.15f;
    if (change) change(in);
    Settings all;
    for (const Decision& decision : decide_training(look, in))
        all.insert(all.end(), decision.settings.begin(), decision.settings.end());
    return all;
}
/// The value of a setting, or `unset`.
double value_of(const Settings& settings, const std::string& key, double unset) {
    double value = unset;
    for (const auto& [name, text] : settings)
        if (name == key) value = std::stod(text);  // the last setting counts
    return value;
}

struct Slope {
    const char* key;
    double bare, covered;  // below 0.02 points per pixel, from 0.1 on
    double step;           // largest change for a 300th of the range
};

TEST(Plan, WhatHangsOnTheCloudChangesByDegrees) {
    for (const auto& [key, bare, covered, step] :
         {Slope{"iterations", 15000, 5000, 35}, Slope{"densify.until", 15000, 4000, 70},
          Slope{"loss.normal.start", 7001, 1, 40}, Slope{"loss.prior_normal.weight", 0, 1, 0.0034},
          Slope{"loss.tv_position.weight", 1, 10, 0.031}, Slope{"tv.vote_every", 10, 50, 1},
          Slope{"tv.refresh_every", 100, 500, 2},
          Slope{"loss.multi_view_geometry.weight", 0, 0.03, 0.00011},
          Slope{"loss.multi_view_ncc.weight", 0, 0.15, 0.00051}}) {
        const auto at = [&, &k = key, &b = bare](double c) { return value_of(by_cloud(c), k, b); };
        for (const double sparse : {0.0, 0.01, 0.02}) EXPECT_EQ(at(sparse), bare) << key << sparse;
        for (const double full : {0.1, 0.8}) EXPECT_NEAR(at(full), covered, 1e-9) << key << full;
        double before = bare;
        for (int i = 1; i <= 300; ++i) {
            const double now = at(0.02 + 0.08 / 300 * i);
            EXPECT_GE((now - before) * (covered > bare ? 1 : -1), 0) << key << " " << i;
            EXPECT_LE(std::abs(now - before), step) << key << " " << i;
            before = now;
        }
    }
    for (int i = 0; i < 300; ++i) {
        const Settings on_the_way = by_cloud(0.02 + 0.08 / 300 * i);
        EXPECT_TRUE(sets(on_the_way, "densify.enabled", "true")) << i;
        EXPECT_NEAR(value_of(on_the_way, "densify.growth_in_gaps_only", -1), i / 300., 1e-4);
    }
    const Settings full = by_cloud(0.1);
    EXPECT_TRUE(sets(full, "densify.enabled", "false"));
    EXPECT_EQ(value_of(full, "densify.growth_in_gaps_only", -1), -1)
        << "growth on request is whole";
    // The limit decreases from infinity to 16 pixels.
    double before = 0;
    for (int i = 1; i <= 301; ++i) {
        const double now =
            1 / value_of(by_cloud(0.02 + 0.08 / 300 * (i - 1)), "mesh.max_scale_px", 1e9);
        EXPECT_GE(now, before);
        EXPECT_LE(now - before, 0.0034 / 16);
        before = now;
    }
    EXPECT_EQ(before, 1 / 16.);
    EXPECT_EQ(value_of(by_cloud(0.01), "loss.normal.start", -1), -1) << "no decision";
}

bool names(const Settings& settings, const std::string& key) {
    return std::any_of(settings.begin(), settings.end(),
                       [&](const auto& setting) { return setting.first == key; });
}
void by_stereo(TrainingInputs& in) {
    in.supported = true, in.options.loss.tv_normal.weight = 1;
}

TEST(Plan, PhotometricGradientsLeaveTheSurfaceOfStereoByDegrees) {
    struct {
        const char* key;
        double bare, covered, step;
    } const slopes[] = {{"init.opacity", 0.1, 0.95, 0.003},
                        {"loss.photometric.geometry", 1, 0, 0.0034},
                        {"lr.supported", 3, 1, 0.012},
                        {"iterations", 15000, 800, 48}};
    for (const auto& [key, bare, covered, step] : slopes) {
        double before = bare;
        for (int i = 1; i <= 300; ++i) {
            const double now = value_of(by_cloud(0.02 + 0.08 / 300 * i, 3, by_stereo), key, -1);
            EXPECT_GE((now - before) * (covered > bare ? 1 : -1), 0) << key << " " << i;
            EXPECT_LE(std::abs(now - before), step) << key << " " << i;
            before = now;
        }
        EXPECT_NEAR(before, covered, 1e-9) << key;
    }
}

TEST(Plan, MoreViewsGiveTheSurfaceToPhotometricGradients) {
    const auto at = [](int views, const char* key) {
        return value_of(by_cloud(0.2, views, by_stereo), key, -1);
    };
    struct {
        int views;
        double iterations, full, rates, votes;  // votes: share of their weight
    } const rows[] = {{2, 533, 0, 1, 1},
                      {3, 800, 0, 1, 1},
                      {5, 1866, 1679, std::pow(3, 1 / 3.), 1 / 3.},
                      {6, 2400, 1440, std::sqrt(3), 0},
                      {9, 2500, 750, 3, 0},
                      {20, 2500, 750, 3, 0},
                      {32, 4000, 1200, 3, 0}};
    for (const auto& [views, iterations, full, rates, votes] : rows) {
        SCOPED_TRACE(views);
        EXPECT_EQ(at(views, "iterations"), iterations);
        EXPECT_EQ(at(views, "loss.photometric.geometry"), 0);
        EXPECT_EQ(at(views, "loss.photometric.geometry_full"), full);
        EXPECT_NEAR(at(views, "lr.supported"), rates, 1e-4);
        EXPECT_EQ(at(views, "loss.multi_view_ncc.start"), 1);
        const Settings all = by_cloud(0.2, views, by_stereo);
        for (const char* key : {"loss.tv_position.weight", "loss.tv_normal.weight"})
            EXPECT_NEAR(value_of(all, key, 1), votes, 1e-4) << "1: that of the preset";
        EXPECT_EQ(sets(all, "tv.enabled", "false"), votes == 0);
        EXPECT_EQ(names(all, "tv.refresh_every"), votes > 0);
    }
    const Settings apart = by_cloud(0.2, 9, by_stereo, 0);
    EXPECT_EQ(value_of(apart, "loss.photometric.geometry_full", -1), 0) << "too far apart";
    EXPECT_EQ(value_of(apart, "lr.supported", -1), 1);
}

TEST(Plan, WidePairsCountLess) {
    const auto at = [](double angle_deg, const char* key) {
        return value_of(by_cloud(0.2, 6, by_stereo, 0, angle_deg), key, -1);
    };
    for (const auto& [angle_deg, weight] :
         {std::pair(40.0, 0.15), {45.0, 0.15}, {52.5, 0.075}, {57.0, 0.03}, {60.0, 0.0}}) {
        SCOPED_TRACE(angle_deg);
        EXPECT_NEAR(at(angle_deg, "loss.multi_view_ncc.weight"), weight, 1e-6);
        EXPECT_EQ(at(angle_deg, "loss.multi_view.fallback_angle_deg"), 60);
        EXPECT_EQ(at(angle_deg, "loss.photometric.geometry_full"), 0) << "too wide to hold them";
    }
    // Without a start by stereo, and where all views have a nearer one.
    const Settings sfm = by_cloud(0.2, 6, {}, 0, 50), near = by_cloud(0.2, 6, by_stereo, 1, 20);
    EXPECT_EQ(value_of(sfm, "loss.multi_view_ncc.weight", -1), 0);
    EXPECT_EQ(value_of(near, "loss.multi_view_ncc.weight", -1), 0.15);
    EXPECT_EQ(value_of(near, "loss.multi_view.fallback_angle_deg", -1), 37);
}

TEST(Plan, DrawsTheBlurredPhotographsWhereStereoMadeTheStart) {
    const auto background = [](const std::function<void(TrainingInputs&)>& change) {
        return sets(by_cloud(0.2, 3, change), "loss.photometric.background", kSoftBackground);
    };
    EXPECT_TRUE(background(by_stereo));
    EXPECT_TRUE(sets(by_cloud(0.2, 3, by_stereo), "loss.photometric.dropout", "0.05"));
    EXPECT_TRUE(sets(by_cloud(0.2, 3, by_stereo), "model.longest_axis", "4"));
    EXPECT_FALSE(background({}));
    for (const MaskUse use : {MaskUse::object, MaskUse::none})
        EXPECT_EQ(background([use](TrainingInputs& in) {
                      by_stereo(in);
                      in.options.loss.photometric.masks = use;
                  }),
                  use == MaskUse::none);
    EXPECT_FALSE(background([](TrainingInputs& in) {
        by_stereo(in);
        in.options.loss.photometric.background = "sky";
    }));
}

TEST(Plan, ConfirmsSurfaceOnlyByViewsThatCanBeCompared) {
    const auto share = [](double in_pairs, double angle_deg) {
        SceneLook look;
        look.views_in_widest_pairs = in_pairs, look.pair_angle_deg = angle_deg;
        return value_of(decide_confirmed(look).settings, "mesh.measured", -1);
    };
    EXPECT_EQ(share(1, 20), 0.5);
    EXPECT_EQ(share(1, 45), 0.5);
    EXPECT_NEAR(share(1, 52.5), 0.25, 1e-6);
    EXPECT_NEAR(share(1, 59.4), 0.02, 1e-6);
    EXPECT_EQ(share(0, 0), 0) << "no pair";
    EXPECT_NEAR(share(0.4, 30), 0.2, 1e-6);
}

TEST(Plan, OnlyAStartByStereoHasASurface) {
    const auto settings = [](const std::function<void(TrainingInputs&)>& change) {
        return by_cloud(0.2, 3, [&](TrainingInputs& in) {
            by_stereo(in);
            change(in);
        });
    };
    for (const char* key : {"init.support", "init.opacity", "init.gap_px", "lr.supported",
                            "loss.photometric.geometry"})
        EXPECT_FALSE(names(by_cloud(0.2), key)) << key;
    for (const auto& all : {settings([](TrainingInputs& in) { in.options.cameras.refine = true; }),
                            settings([](TrainingInputs& in) { in.parts_colors = false; })}) {
        EXPECT_TRUE(sets(all, "init.support", "true"));
        EXPECT_FALSE(names(all, "loss.photometric.geometry")) << "would be refused";
    }
}

}  // namespace
}  // namespace tvsgs
