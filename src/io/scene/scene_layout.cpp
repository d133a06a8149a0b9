#include "io/scene/scene_layout.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "core/log.h"
#include "io/files/read_file.h"
#include "io/images/image_file.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

constexpr const char* kModelFolders[] = {"sparse/0", "sparse", "dense/sparse", "colmap/sparse/0",
                                         "."};

bool has(const fs::path& scene, const char* name) {
    std::error_code error;
    return fs::exists(scene / name, error);
}

/// True if there are cameras of MVSNet, in cams/ or cams_1/.
bool has_mvsnet(const fs::path& scene) {
    for (const char* folder : {"cams", "cams_1"}) {
        std::error_code error;
        for (const auto& entry : fs::directory_iterator(scene / folder, error))
            if (entry.path().filename().string().ends_with("_cam.txt")) return true;
    }
    return false;
}

SceneLayout read_colmap_layout(const SceneOptions& options) {
    const fs::path scene(options.path);
    std::string tried;
    bool incomplete = false;
    for (const char* folder : kModelFolders) {
        const std::string path = (scene / folder).string();
        const std::vector<std::string> missing = missing_colmap_files(path);
        if (!missing.empty()) {
            tried += "\n  " + path;
            if (missing.size() == 1) tried += str(" (no ", missing[0], ")"), incomplete = true;
            continue;
        }
        if (std::string(folder) == "sparse/0" && has(scene, "sparse/1"))
            spdlog::warn("{}: COLMAP made several models; only sparse/0 is used", options.path);
        return {"colmap", path, (scene / options.images).string(), read_colmap_model(path)};
    }
    std::string photographs;
    for (const fs::path& folder : {scene, scene / options.images})
        if (photographs.empty() && !image_names(folder.string()).empty())
            photographs = folder.string();
    const std::string expected =
        str(": no COLMAP model (cameras.{bin,txt} and images.{bin,txt}) in", tried,
            "\n  and no transforms_train.json (Blender), transforms.json (nerfstudio), "
            "cameras_sphere.npz or cameras.npz (IDR, NeuS) or cams/*_cam.txt (MVSNet).\n  Give the "
            "folder that holds sparse/ and the images.");
    if (photographs.empty() || incomplete)
        throw input_error("E_SCENE_LAYOUT: ", options.path, expected);
    spdlog::debug("{}{}", options.path, expected);
    throw input_error("E_SCENE_LAYOUT: ", options.path,
                      ": no camera positions. Run:\n    tvsgs-prepare ", photographs, " SCENE");
}

}  // namespace

SceneLayout read_layout(const SceneOptions& options) {
    const fs::path scene(options.path);
    std::error_code no_matter;
    if (!fs::is_directory(scene, no_matter))
        throw input_error("E_SCENE_LAYOUT: ", options.path,
                          fs::exists(scene, no_matter) ? ": is a file" : ": not found",
                          "; expected the folder that holds sparse/ and the images");
    const auto is = [&](SceneFormat format, const auto& fits) {
        return options.format == format || (options.format == SceneFormat::automatic && fits());
    };
    const auto has_model = [&] {
        return std::ranges::any_of(kModelFolders, [&](const char* folder) {
            return missing_colmap_files((scene / folder).string()).empty();
        });
    };
    const auto has_npz = [&] {
        return has(scene, "cameras_sphere.npz") || has(scene, "cameras.npz") ||
               !options.cameras_file.empty();
    };
    if (is(SceneFormat::colmap, has_model)) return read_colmap_layout(options);
    if (is(SceneFormat::blender, [&] { return has(scene, "transforms_train.json"); }))
        return read_blender_layout(options);
    if (is(SceneFormat::nerfstudio, [&] { return has(scene, "transforms.json"); }))
        return read_nerfstudio_layout(options);
    if (is(SceneFormat::idr, has_npz)) return read_npz_layout(options);
    if (is(SceneFormat::mvsnet, [&] { return has_mvsnet(scene); }))
        return read_mvsnet_layout(options);
    return read_colmap_layout(options);  // reports what is missing
}

std::vector<std::string> image_names(const std::string& folder) {
    std::vector<std::string> names;
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder, error)) {
        if (has_image_extension(entry.path().string()))
            names.push_back(entry.path().filename().string());
    }
    std::ranges::sort(names);
    return names;
}

std::string find_image_folder(const SceneOptions& options,
                              const std::vector<std::string>& standard) {
    const fs::path scene(options.path);
    std::string tried;
    std::vector<std::string> folders{options.images};
    folders.insert(folders.end(), standard.begin(), standard.end());
    for (const std::string& name : folders) {
        const std::string folder = (scene / name).string();
        if (!image_names(folder).empty()) return folder;
        tried += (tried.empty() ? "" : ", ") + folder;
    }
    throw input_error("E_NO_IMAGES: ", options.path, ": no photographs in ", tried,
                      "; give their folder with --images");
}

void add_view(SceneLayout& layout,
              const std::string& name,
              const Intrinsics& camera,
              Rigid3d pose) {
    const auto id = static_cast<std::uint32_t>(layout.model.images.size() + 1);
    layout.model.cameras.emplace(id, camera);
    layout.model.images.push_back({id, id, pose, name});
}

Rigid3d checked_pose(const Mat3<double>& R, Vec3d t, const std::string& where) {
    bool finite = is_finite(t);
    for (int i = 0; i < 3; ++i) finite = finite && is_finite(column(R, i));
    if (!finite)
        throw input_error("E_POSE_NAN: ", where, ": the pose is not finite; remove the image");
    const Mat3<double> square = R * transpose(R);
    double worst = 0;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            worst = std::max(worst, std::abs(square[i][j] - (i == j ? 1 : 0)));
    const double det = dot(column(R, 0), cross(column(R, 1), column(R, 2)));
    if (!(worst <= 1e-3 && det > 0))
        throw input_error("E_POSE_ROT: ", where, ": ",
                          det < 0
                              ? std::string("this pose is mirrored: check the axis convention")
                              : str("the 3x3 part of the pose is not a rotation (error ", worst,
                                    ", determinant ", det, "); remove the scale from the poses"));
    const Vec3d z = normalize(column(R, 2)), y = normalize(cross(z, column(R, 0))), x = cross(y, z);
    Rigid3d pose;
    for (int i = 0; i < 3; ++i) pose.R[i][0] = x[i], pose.R[i][1] = y[i], pose.R[i][2] = z[i];
    pose.t = t;
    return pose;
}

SceneLayout finished(SceneLayout layout) {
    if (layout.model.images.empty())
        throw input_error("E_NO_IMAGES: ", layout.source, ": none of its images was found");
    sort_by_name(layout.model.images, layout.source);
    return layout;
}

}  // namespace tvsgs
