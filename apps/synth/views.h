// The options and cameras of tvsgs-synth, the choice of training and test views, and what it
// writes.
#pragma once

#include <algorithm>
#include <cmath>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "core/log.h"
#include "core/math/rigid.h"
#include "core/math/rng.h"
#include "core/scene/camera.h"
#include "core/scene/mesh.h"
#include "render/tiles/camera_math.h"

namespace tvsgs::synth {

constexpr Vec3d kLookAt{0, 0, 0.85};
constexpr double kDistance = 4.5;  // of the cameras from the target

/// Format and errors of the priors.
struct SynthPriors {
    std::string format{};                 // empty: none
    std::string quantity = "depth";       // npy, vggt, json: the quantity of the numbers
    std::string frame = "camera_opencv";  // of normals, if the format does not define it
    std::string declare{};                // json: the quantity that it declares
    bool ray = false, normals_away = false;
    double scale = 1, noise = 0, holes = 0;
};

struct SynthOptions {
    std::string out, shape = "bust";
    int views = 24, width = 160, height = 120, points = 8000;
    std::optional<int> test_views;  // empty: every eighth
    double arc_deg = 360, elevation_span_deg = 36;
    double wide = 0;  // side of the ground of the wide scene; 0: one object
    double noise = 0, exposure_drift = 0, shininess = 0, texture = 1, pose_noise = 0;
    std::string background = "empty", lens = "PINHOLE";
    std::uint64_t seed = 1;
    bool masks = true, overwrite = false;
    SynthPriors priors;
};

struct SynthView {
    std::string name;
    double azimuth_rad;
    Quat<double> quat;  // camera_from_world
    Vec3d translation;
    Camera camera;
    Rigid3d pose() const { return {rotation(quat), translation}; }
};

/// Writes a scene to the folder `out`, which must exist: photographs, cameras, initial points,
/// masks, priors, the exact surface. The same options give the same files.
void write_scene(const SynthOptions& options, const std::string& out);

/// The formats of --priors.
inline const std::vector<std::string> kPriorFormats{"npy",    "vggt", "params",   "colmap",
                                                    "mvsnet", "acmm", "omnidata", "json"};

/// Writes priors in the formats of other programs: depth and normals of one view, and the format's
/// other files.
void write_priors(const std::string& out,
                  const TriangleMesh& mesh,
                  const SynthOptions& options,
                  const SynthView& view,
                  int index);

/// Writes the format's files for all views together.
void finish_priors(const std::string& out,
                   const TriangleMesh& mesh,
                   const SynthOptions& options,
                   const std::vector<SynthView>& views);

constexpr double kDegree = 3.14159265358979323846 / 180;

/// View `i` at `distance` from its target, in the direction of an azimuth and an elevation.
inline SynthView make_view(const SynthOptions& options,
                           int i,
                           Vec3d look_at,
                           double distance,
                           double azimuth_rad,
                           double elevation_rad) {
    SynthView view;
    view.name = fmt::format("{:04}.png", i);
    view.azimuth_rad = azimuth_rad;
    const Vec3d backward{std::cos(azimuth_rad) * std::cos(elevation_rad),
                         std::sin(azimuth_rad) * std::cos(elevation_rad), std::sin(elevation_rad)};
    const Vec3d right = normalize(cross(Vec3d{0, 0, 1}, backward)), down = cross(right, backward);
    Mat3<double> R;
    for (int c = 0; c < 3; ++c) R[0][c] = right[c], R[1][c] = down[c], R[2][c] = -backward[c];
    view.quat = quaternion(R);
    R = rotation(view.quat);
    view.translation = -(R * (look_at + distance * backward));
    Camera& camera = view.camera;
    camera.width_px = options.width, camera.height_px = options.height;
    // Focal lengths and principal point of a real camera: not quite equal, not quite central.
    const float size = static_cast<float>(std::min(options.width, options.height * 4 / 3));
    camera.fx_px = 1.2f * size, camera.fy_px = 1.197f * size;
    camera.cx_px = 0.506f * static_cast<float>(options.width);
    camera.cy_px = 0.493f * static_cast<float>(options.height);
    camera.camera_from_world = {mat_cast<float>(R), vec_cast<float>(view.translation)};
    return view;
}

/// Cameras around the object, alternating between three heights, all looking at its centre; the
/// front is at azimuth 0.
inline std::vector<SynthView> make_views(const SynthOptions& options) {
    const bool ring = options.arc_deg >= 360;
    std::vector<SynthView> views;
    for (int i = 0; i < options.views; ++i) {
        const double fraction =
            static_cast<double>(i) / (ring ? options.views : std::max(1, options.views - 1));
        const double elevation = (32 + 0.5 * options.elevation_span_deg * (i % 3 - 1)) * kDegree;
        views.push_back(make_view(options, i, kLookAt, kDistance,
                                  (fraction - 0.5) * options.arc_deg * kDegree, elevation));
    }
    return views;
}

/// Adds random errors to the poses: rotates and shifts them so that the images of points at the
/// object's distance move by about `px` (root mean square).
inline std::vector<SynthView> moved_views(std::vector<SynthView> views,
                                          const std::vector<int>& which,
                                          double px,
                                          std::uint64_t seed) {
    for (const int i : which) {
        SynthView& view = views[i];
        const auto draw = [&](std::uint32_t what) {
            const Random4 r =
                random4(seed, RandomStream::pose_noise, static_cast<std::uint64_t>(i), what);
            // Each of the two image directions of rotation and shift gets its share.
            return 0.5 * px / view.camera.fx_px * vec_cast<double>(normal3(r));
        };
        const Rigid3d pose = rigid_exp(draw(0), kDistance * draw(1)) * view.pose();
        view.quat = quaternion(pose.R), view.translation = pose.t;
    }
    return views;
}

struct Splits {
    std::vector<int> train_3, train_9, train_all, test;
};

/// Test views among `count`: every eighth (the last of three or more if there are fewer than
/// eight), or `wanted` evenly between the first and the last view, so that training spans the arc.
inline std::vector<bool> choose_test_views(int count, std::optional<int> wanted) {
    std::vector<bool> is_test(count);
    for (int i = 0; i < count && !wanted; ++i)
        is_test[i] = count < 8 ? count >= 3 && i == count - 1 : i % 8 == 7;
    for (int k = 0; k < wanted.value_or(0); ++k)
        is_test[1 + (2 * k + 1) * (count - 2) / (2 * *wanted)] = true;
    return is_test;
}

/// train_3 is the three training views nearest to the front, train_9 an even choice.
inline Splits make_splits(const std::vector<SynthView>& views, std::optional<int> test_views) {
    const int count = static_cast<int>(views.size());
    const std::vector<bool> is_test = choose_test_views(count, test_views);
    Splits splits;
    for (int i = 0; i < count; ++i) (is_test[i] ? splits.test : splits.train_all).push_back(i);
    splits.train_3 = splits.train_all;
    const auto nearest_end =
        splits.train_3.begin() + std::min<std::ptrdiff_t>(3, std::ssize(splits.train_3));
    std::partial_sort(splits.train_3.begin(), nearest_end, splits.train_3.end(), [&](int a, int b) {
        const double to_a = std::abs(views[a].azimuth_rad), to_b = std::abs(views[b].azimuth_rad);
        return std::abs(to_a - to_b) > 1e-9 ? to_a < to_b : a < b;
    });
    splits.train_3.erase(nearest_end, splits.train_3.end());
    std::sort(splits.train_3.begin(), splits.train_3.end());
    const int all = static_cast<int>(splits.train_all.size());
    for (int i = 0; all >= 9 && i < 9; ++i) splits.train_9.push_back(splits.train_all[i * all / 9]);
    return splits;
}

inline std::string splits_json(const Splits& splits, const std::vector<SynthView>& views) {
    std::ostringstream out;
    const auto add = [&](const char* name, const std::vector<int>& list) {
        if (list.empty() && std::string(name) != "test") return;
        out << (out.tellp() == 0 ? "{\n" : ",\n") << "  \"" << name << "\": [";
        for (std::size_t i = 0; i < list.size(); ++i)
            out << (i ? ", " : "") << '"' << views[list[i]].name << '"';
        out << ']';
    };
    add("train_3", splits.train_3);
    add("train_9", splits.train_9);
    add("train_all", splits.train_all);
    add("test", splits.test);
    out << "\n}\n";
    return out.str();
}

}  // namespace tvsgs::synth
