#include "io/scene/npz_cameras.h"

#include <cmath>

#include "core/log.h"
#include "core/math/rigid.h"
#include "io/files/npz.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

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

}  // namespace tvsgs
