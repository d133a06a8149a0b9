// Reads DTU scans in the layout of IDR and NeuS, and cameras of MVSNet.
// [docs/method/input.md#cameras-of-idr-and-neus, docs/method/input.md#cameras-of-mvsnet]
#include <cmath>
#include <filesystem>

#include "core/log.h"
#include "io/files/npz.h"
#include "io/files/read_file.h"
#include "io/images/image_file.h"
#include "io/scene/scene_layout.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

/// Rows of the named 4x4 (or 3x4) matrix.
const std::vector<double>& matrix(const NpzArchive& archive,
                                  const std::string& path,
                                  const std::string& name) {
    const NpyArray& array = archive.at(name);
    const bool fits = array.shape.size() == 2 && (array.shape[0] == 4 || array.shape[0] == 3) &&
                      array.shape[1] == 4;
    if (!fits) throw input_error("E_NPZ_CAMERAS: ", path, ": ", name, " is not a 4x4 matrix");
    for (const double entry : array.numbers)
        if (!std::isfinite(entry))
            throw input_error("E_NPZ_CAMERAS: ", path, ": ", name, " is not finite");
    return array.numbers;
}

NpzCamera take_apart(const std::vector<double>& m, const std::string& where) {
    NpzCamera camera;
    Vec3d(&rows)[3] = camera.rows, &last = camera.last;
    for (std::size_t i = 0; i < 3; ++i) {
        rows[i] = {m[4 * i], m[4 * i + 1], m[4 * i + 2]};
        last[static_cast<int>(i)] = m[4 * i + 3];
    }
    // P is known up to a factor. The sign of the factor must give a proper rotation.
    if (dot(rows[0], cross(rows[1], rows[2])) < 0) {
        for (Vec3d& row : rows) row = -row;
        last = -last;
    }
    // Solves K R = rows from the last row up: K is upper triangular.
    const double k22 = norm(rows[2]);
    const Vec3d r2 = rows[2] / k22;
    const double k12 = dot(rows[1], r2);
    const Vec3d along1 = rows[1] - k12 * r2;
    const double k11 = norm(along1);
    const Vec3d r1 = along1 / k11;
    const double k02 = dot(rows[0], r2), k01 = dot(rows[0], r1);
    const Vec3d along0 = rows[0] - k02 * r2 - k01 * r1;
    const double k00 = norm(along0);
    const Vec3d r0 = along0 / k00;
    if (!(k22 > 0 && k11 > 1e-12 * k22 && k00 > 1e-12 * k22))
        throw input_error("E_NPZ_CAMERAS: ", where,
                          ": the matrix is singular; expected K [R | t] of a camera");
    camera.fx_px = k00 / k22, camera.fy_px = k11 / k22;
    camera.cx_px = k02 / k22, camera.cy_px = k12 / k22;
    if (std::abs(k01 / k22) > 0.1)
        spdlog::warn("{}: ignored a skew of {:.3g} px", where, k01 / k22);
    for (int j = 0; j < 3; ++j)
        camera.camera_from_world.R[0][j] = r0[j], camera.camera_from_world.R[1][j] = r1[j],
        camera.camera_from_world.R[2][j] = r2[j];
    // Solves K t = last by substitution.
    const double tz = last.z / k22, ty = (last.y - k12 * tz) / k11;
    camera.camera_from_world.t = {(last.x - k02 * tz - k01 * ty) / k00, ty, tz};
    return camera;
}

/// The file with the cameras. If both exist and normalise differently, the user must choose.
std::string find_camera_file(const SceneOptions& options) {
    const fs::path scene(options.path);
    if (!options.cameras_file.empty()) {
        const fs::path inside = scene / options.cameras_file;
        return fs::exists(inside) ? inside.string() : options.cameras_file;
    }
    const std::string sphere = (scene / "cameras_sphere.npz").string(),
                      plain = (scene / "cameras.npz").string();
    if (!fs::exists(sphere) && !fs::exists(plain))
        throw input_error("E_SCENE_LAYOUT: ", options.path,
                          ": no cameras_sphere.npz or cameras.npz");
    if (!fs::exists(sphere) || !fs::exists(plain)) return fs::exists(sphere) ? sphere : plain;
    const NpzCameras a = read_npz_cameras(sphere), b = read_npz_cameras(plain);
    if (std::abs(a.scale - b.scale) > 1e-6 * a.scale || norm(a.offset - b.offset) > 1e-6 * a.scale)
        throw input_error("E_SCALE_MAT: ", options.path,
                          ": cameras_sphere.npz and cameras.npz differ in scale_mat_0; choose one "
                          "with scene.cameras_file, and evaluate with the same");
    return sphere;
}

/// Ratio of the camera's width to the image's width, for cameras of larger images: 1, 2, 4 or 8.
int camera_scale(double cx_px, int width, const std::string& where) {
    for (const int q : {1, 2, 4, 8})
        if (std::abs(2 * cx_px - q * width) <= 0.2 * q * width) return q;
    throw input_error("E_CAM_SCALE: ", where, ": the principal point is at ", cx_px,
                      " px, for an image ", width,
                      " px wide; expected cameras of this size, or of 2, 4 or 8 times it");
}

/// `params`: focal lengths and principal point.
Intrinsics pinhole(const std::string& path,
                   std::size_t id,
                   int width,
                   int height,
                   const std::vector<double>& params) {
    return make_intrinsics(path, static_cast<std::uint32_t>(id), *find_camera_model("PINHOLE"),
                           static_cast<std::uint64_t>(width), static_cast<std::uint64_t>(height),
                           params);
}

}  // namespace

NpzCameras read_npz_cameras(const std::string& path) {
    const NpzArchive archive = read_npz(path);
    NpzCameras cameras;
    for (int i = 0; archive.contains(str("world_mat_", i)); ++i) {
        const std::string name = str("world_mat_", i), scale_name = str("scale_mat_", i);
        cameras.views.push_back(take_apart(matrix(archive, path, name), str(path, ": ", name)));
        if (!archive.contains(scale_name)) continue;
        const std::vector<double>& m = matrix(archive, path, scale_name);
        const double s = m[0];
        const Vec3d offset{m[3], m[7], m[11]};
        bool uniform = s > 0;
        for (std::size_t r = 0; r < 3; ++r)
            for (std::size_t c = 0; c < 3; ++c)
                uniform = uniform && std::abs(m[4 * r + c] - (r == c ? s : 0)) <= 1e-4 * s;
        if (!uniform)
            throw input_error("E_SCALE_MAT: ", path, ": ", scale_name,
                              ": expected a uniform scale and a shift");
        if (i == 0) {
            cameras.scale = s, cameras.offset = offset;
        } else if (std::abs(s - cameras.scale) > 1e-4 * s ||
                   norm(offset - cameras.offset) > 1e-4 * s) {
            throw input_error("E_SCALE_MAT: ", path, ": ", scale_name,
                              " differs from scale_mat_0; expected one for the whole scan");
        }
    }
    if (cameras.views.empty())
        throw input_error(
            "E_NPZ_CAMERAS: ", path,
            ": no world_mat_0; expected world_mat_i and scale_mat_i, as of IDR and NeuS");
    return cameras;
}

SceneLayout read_npz_layout(const SceneOptions& options) {
    const std::string cameras_file = find_camera_file(options);  // most often missing: first
    SceneLayout layout{"idr", cameras_file, find_image_folder(options, {"image", "images"})};
    const NpzCameras cameras = read_npz_cameras(layout.source);
    const std::vector<std::string> names = image_names(layout.images);
    if (names.size() != cameras.views.size())
        throw input_error("E_VIEW_COUNT: ", layout.source, ": ", cameras.views.size(),
                          " cameras for ", names.size(), " photographs in ", layout.images,
                          "; the i-th camera belongs to the i-th file");
    for (std::size_t i = 0; i < names.size(); ++i) {
        const NpzCamera& camera = cameras.views[i];
        const std::string where = str(layout.source, ": world_mat_", i);
        const ImageSize size = read_image_size((fs::path(layout.images) / names[i]).string());
        const int q = camera_scale(camera.cx_px, size.width, where);
        Rigid3d pose = checked_pose(camera.camera_from_world.R, camera.camera_from_world.t, where);
        // In the normalised frame camera coordinates shrink by the same scale.
        pose.t = (pose.R * cameras.offset + pose.t) / cameras.scale;
        add_view(layout, names[i],
                 pinhole(layout.source, i, q * size.width, q * size.height,
                         {camera.fx_px, camera.fy_px, camera.cx_px + options.pixel_offset,
                          camera.cy_px + options.pixel_offset}),
                 pose);
    }
    spdlog::info("{}: {} cameras, normalised by scale_mat_0: 1 unit is {:.6g} world units",
                 layout.source, cameras.views.size(), cameras.scale);
    return finished(std::move(layout));
}

SceneLayout read_mvsnet_layout(const SceneOptions& options) {
    const fs::path scene(options.path);
    SceneLayout layout{"mvsnet",
                       (scene / (fs::exists(scene / "cams") ? "cams" : "cams_1")).string(),
                       find_image_folder(options, {"images", "image", "blended_images"})};
    std::size_t cameras = 0;
    for (const std::string& name : image_names(layout.images)) {
        const std::string path = layout.source + "/" + fs::path(name).stem().string() + "_cam.txt";
        if (!fs::exists(path)) continue;
        ++cameras;
        const std::string text = read_text(path);
        std::string_view rest = text;
        const auto expect = [&](std::string_view word) {
            if (const auto found = next_word(rest); found != word)
                throw input_error("E_MVSNET_CAM: ", path, ": expected '", word, "', found '",
                                  shown(found), "'");
        };
        const auto read = [&](double* to, int count) {
            for (int i = 0; i < count; ++i)
                if (const auto word = next_word(rest); !parse_number(word, to[i]))
                    throw input_error("E_MVSNET_CAM: ", path, ": '", shown(word),
                                      "' is not a number; expected ", count,
                                      " numbers in this matrix");
        };
        double pose[16], K[9];
        expect("extrinsic"), read(pose, 16);
        expect("intrinsic"), read(K, 9);
        Mat3<double> R;
        for (int r = 0; r < 3; ++r)
            for (int c = 0; c < 3; ++c) R[r][c] = pose[4 * r + c];
        const Rigid3d camera_from_world = checked_pose(R, {pose[3], pose[7], pose[11]}, path);
        const ImageSize size = read_image_size((fs::path(layout.images) / name).string());
        // Cameras in the networks' training data suit images reduced to a quarter.
        const double ratio = size.width / (2 * K[2]);
        double q = 1;
        if (std::abs(2 * K[2] - size.width) > 0.2 * size.width) {
            q = ratio > 1 ? std::exp2(std::round(std::log2(ratio))) : 0;
            if (!(q >= 2 && q <= 8 && std::abs(ratio - q) <= 0.2 * q))
                throw input_error("E_CAM_SCALE: ", path, ": the principal point is at ", K[2],
                                  " px, for an image ", size.width, " px wide");
            if (cameras == 1)
                spdlog::info("{}: scaled up cameras of images reduced {:g} times", path, q);
        }
        add_view(layout, name,
                 pinhole(path, cameras, size.width, size.height,
                         {q * K[0], q * K[4], q * (K[2] + options.pixel_offset),
                          q * (K[5] + options.pixel_offset)}),
                 camera_from_world);
    }
    return finished(std::move(layout));
}

}  // namespace tvsgs
