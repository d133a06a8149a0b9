// Makes a scene, writes priors for it and reads them.
#pragma once

#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <sstream>
#include <tuple>

#include "apps/synth/views.h"
#include "core/error.h"
#include "core/log.h"
#include "core/scene/prior_maps.h"
#include "io/files/npz.h"
#include "io/scene/scene_reader.h"
#include "io/splats/ply.h"
#include "mesh/draw/mesh_render.h"
#include "pipeline/priors/priors.h"
#include "support/command.h"

namespace tvsgs {

inline const MapNames kAllPriors{prior_map::kDepth,      prior_map::kDepthOrder,
                                 prior_map::kConfidence, prior_map::kNormal,
                                 prior_map::kFeatures,   prior_map::kCoarseFeatures};

inline const ViewMap* find(const View& view, std::string_view name) {
    for (const ViewMap& map : view.maps)
        if (map.name == name) return &map;
    return nullptr;
}

class Priors : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = std::filesystem::path(testing::TempDir()) /
                  ("tvsgs_priors_" + std::to_string(::getpid()));
        std::filesystem::create_directories(folder_);
        ASSERT_EQ(run_tool(folder_, "synth", "--out scene --views 5 --points 3000 --quiet").code,
                  0);
        synth_.views = 5;
        const PlyContents ply = read_ply(folder_ / "scene/gt/mesh.ply");
        mesh_ = {ply.points.positions, ply.points.colors, ply.faces};
        SceneOptions options;
        options.path = folder_ / "scene";
        scene_ = read_scene(options);
        for (const View& view : scene_.train) truth_.push_back(render_mesh(mesh_, view.camera));
    }
    static void TearDownTestSuite() { std::filesystem::remove_all(folder_); }

    /// Writes priors into a new folder of the scene.
    std::string write(const synth::SynthPriors& priors) const {
        const std::string name = testing::UnitTest::GetInstance()->current_test_info()->name();
        const std::filesystem::path out = folder_ / "scene" / name;
        std::filesystem::remove_all(out);
        synth::SynthOptions options = synth_;
        options.priors = priors;
        const std::vector<synth::SynthView> views = synth::make_views(options);
        for (int i = 0; i < options.views; ++i)
            synth::write_priors(out, mesh_, options, views[static_cast<std::size_t>(i)], i);
        synth::finish_priors(out, mesh_, options, views);
        return name;
    }
    Scene read_folder(const std::string& dir,
                      PriorOptions options = {},
                      const MapNames& wanted = kAllPriors) {
        Scene scene = scene_;
        options.dir = dir;
        SceneOptions scene_options;
        scene_options.path = folder_ / "scene";
        const auto kept = spdlog::default_logger();
        std::ostringstream log;
        spdlog::set_default_logger(std::make_shared<spdlog::logger>(
            "", std::make_shared<spdlog::sinks::ostream_sink_mt>(log)));
        try {
            read_priors(options, wanted, scene_options, scene);
        } catch (...) {
            spdlog::set_default_logger(kept);
            throw;
        }
        spdlog::set_default_logger(kept);
        said_ = log.str();
        return scene;
    }
    Scene read(const synth::SynthPriors& priors, const PriorOptions& options = {}) {
        return read_folder(write(priors) + (priors.format == "json" ? "/priors" : ""), options);
    }
    void expect_refused(const synth::SynthPriors& priors,
                        const std::string& text,
                        const PriorOptions& options = {}) {
        try {
            read(priors, options);
            ADD_FAILURE() << "read; expected an error with '" << text << "': " << said_;
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::input);
            EXPECT_NE(std::string(error.what()).find(text), std::string::npos) << error.what();
        }
    }
    bool said(const std::string& text) const { return said_.find(text) != std::string::npos; }

    /// Checks the median of |depth / truth - 1|, and the share of the surface with a depth.
    static void expect_depth(const Scene& scene, double error, double share = 0.95) {
        for (std::size_t v = 0; v < scene.train.size(); ++v) {
            const ViewMap* const map = find(scene.train[v], prior_map::kDepth);
            ASSERT_NE(map, nullptr) << scene.train[v].name;
            ASSERT_EQ(map->width_px, scene.train[v].photo.width);
            ASSERT_EQ(map->values.size(), truth_[v].depth.pixels.size());
            std::vector<double> errors;
            double surface = 0;
            for (std::size_t i = 0; i < map->values.size(); ++i) {
                const float z = truth_[v].depth.pixels[i];
                surface += z > 0;
                if (map->values[i] > 0 && z > 0)
                    errors.push_back(std::abs(double(map->values[i]) / double(z) - 1));
            }
            EXPECT_GE(static_cast<double>(errors.size()), share * surface) << v;
            std::nth_element(errors.begin(), errors.begin() + std::ssize(errors) / 2, errors.end());
            EXPECT_LT(errors[errors.size() / 2], error) << scene.train[v].name;
        }
    }
    static void expect_normals(const Scene& scene, double least_cosine) {
        for (std::size_t v = 0; v < scene.train.size(); ++v) {
            const ViewMap* const map = find(scene.train[v], prior_map::kNormal);
            ASSERT_NE(map, nullptr) << scene.train[v].name;
            double sum = 0, count = 0;
            for (std::size_t i = 0; i < map->values.size() / 3; ++i) {
                const float* const n = &map->values[3 * i];
                const float* const t = &truth_[v].normal.pixels[3 * i];
                if (n[0] == 0 && n[1] == 0 && n[2] == 0) continue;
                ASSERT_NEAR(n[0] * n[0] + n[1] * n[1] + n[2] * n[2], 1, 1e-4f);
                const int x = static_cast<int>(i) % map->width_px,
                          y = static_cast<int>(i) / map->width_px;
                ASSERT_LT(dot(Vec3f{n[0], n[1], n[2]}, pixel_ray(scene.train[v].camera, x, y)), 0);
                sum += std::abs(double(n[0] * t[0] + n[1] * t[1] + n[2] * t[2])), ++count;
            }
            EXPECT_GT(count, 1000);
            EXPECT_GT(sum / count, least_cosine) << scene.train[v].name;
        }
    }

    std::string said_;
    static inline std::filesystem::path folder_;
    static inline synth::SynthOptions synth_;
    static inline TriangleMesh mesh_;
    static inline Scene scene_;
    static inline std::vector<MeshRender> truth_;
};

}  // namespace tvsgs
