// Makes scenes for tests of the plan, and reads its decisions.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "plan/decide.h"

namespace tvsgs::test {
inline constexpr double kDegree = 3.14159265358979 / 180;

/// A photograph of the textured plane z = 0; `gain` scales it.
inline ImageU8 photo_of_plane(const Camera& camera, double gain = 1) {
    ImageU8 photo(camera.width_px, camera.height_px, 3);
    const Vec3f from = camera_centre(camera);
    for (int y = 0; y < photo.height; ++y)
        for (int x = 0; x < photo.width; ++x) {
            const Vec3f ray = transpose_times(camera.camera_from_world.R, pixel_ray(camera, x, y));
            const Vec3f p = from - (from.z / ray.z) * ray;
            const double grey = 100 + 40 * std::sin(20. * p.x) * std::sin(17. * p.y);
            for (int c = 0; c < 3; ++c)
                photo.at(x, y, c) = static_cast<std::uint8_t>(gain * grey + 0.5);
        }
    return photo;
}

/// Cameras on an arc in front of a textured plane, `step_deg` apart at a distance of 5 units;
/// `points` points on the plane, visible in all views.
inline Scene patch_scene(int views, double step_deg, int points) {
    Scene scene;
    for (int v = 0; v < views; ++v) {
        View view;
        const double angle = (v - 0.5 * (views - 1)) * step_deg * kDegree;
        const auto c = static_cast<float>(std::cos(angle)), s = static_cast<float>(std::sin(angle));
        view.camera = {100, 80, 200, 200, 50, 40, {}};
        // Axes of a camera at (5 s, 0, -5 c) that looks at the origin.
        view.camera.camera_from_world.R = {{{c, 0, s}, {0, 1, 0}, {-s, 0, c}}};
        view.camera.camera_from_world.t = {0, 0, 5};
        view.photo = photo_of_plane(view.camera);
        view.name = std::to_string(v);
        scene.train.push_back(std::move(view));
    }
    for (int i = 0; i < points; ++i) {
        const float x = static_cast<float>(i % 40) / 40 - 0.5f,
                    y = static_cast<float>(i / 40 % 40) / 40 - 0.5f;
        scene.points.positions.push_back({x, y, 1e-4f * static_cast<float>(i / 1600)});
    }
    scene.extent = 5;
    return scene;
}

inline std::string choice(const std::vector<Decision>& plan, const std::string& name) {
    for (const Decision& decision : plan)
        if (decision.name == name) return decision.choice;
    return "no such decision";
}

inline std::vector<Decision> plan_of(const SceneLook& look, bool dense = false, int wanted = -1) {
    TrainingInputs in;
    in.dense = dense, in.configured = 15000, in.wanted = wanted;
    in.options.iterations = wanted > 0 ? wanted : 15000, in.options.loss.tv_normal.start = 3000;
    in.multi_view.multi_view_geometry.weight = 0.25f, in.multi_view.multi_view_ncc.weight = 0.5f;
    return decide_training(look, in);
}

inline Settings settings(const std::vector<Decision>& plan, const std::string& name) {
    for (const Decision& decision : plan)
        if (decision.name == name) return decision.settings;
    ADD_FAILURE() << "no decision " << name;
    return {};
}
inline bool sets(const Settings& settings, const std::string& key, const std::string& value) {
    return std::find(settings.begin(), settings.end(), std::pair(key, value)) != settings.end();
}

inline SceneLook look_of(const Scene& scene) {
    return look_at(scene, ViewPairOptions{});
}

}  // namespace tvsgs::test
