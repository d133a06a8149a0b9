#include "eval/dtu_files.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numeric>

#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"
#include "io/files/npz.h"
#include "io/files/read_file.h"
#include "io/images/image_file.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

/// Path of the truth relative to the evaluation set.
std::string stl_name(int scan) {
    return fmt::format("Points/stl/stl{:03}_total.ply", scan);
}

std::string distribution(int scan) {
    return str("  expected DIR/", stl_name(scan), ", DIR/ObsMask/ObsMask", scan,
               "_10.mat and DIR/ObsMask/Plane", scan,
               ".mat\n  (or below 'DIR/SampleSet/MVS Data'), from Points.zip and SampleSet.zip of "
               "the benchmark: "
               "https://roboimagedata.compute.dtu.dk/?page_id=36");
}

/// Finds a file of the evaluation set in one of the two usual folder layouts.
std::string find_in(const std::string& folder, int scan, const std::string& name) {
    for (const char* below : {"", "SampleSet/MVS Data"}) {
        const std::string path = (fs::path(folder) / below / name).string();
        std::error_code error;
        if (fs::is_regular_file(path, error)) return path;
    }
    throw input_error((fs::path(folder) / name).string(), ": not found\n", distribution(scan));
}

ObservationMask read_mask(const std::string& path) {
    const MatArray mask = read_mat_array(path, "ObsMask"), box = read_mat_array(path, "BB"),
                   size = read_mat_array(path, "Res");
    const bool fits = mask.shape.size() == 3 && box.shape == std::vector<std::int64_t>{2, 3} &&
                      size.numbers.size() == 1 && size.numbers[0] > 0;
    if (!fits)
        throw input_error("E_MAT: ", path,
                          ": expected ObsMask in three dimensions, BB 2x3 and one "
                          "positive number Res");
    ObservationMask out;
    out.nx = static_cast<int>(mask.shape[0]), out.ny = static_cast<int>(mask.shape[1]),
    out.nz = static_cast<int>(mask.shape[2]);
    for (const double value : mask.numbers) out.seen.push_back(value != 0);
    for (int axis = 0; axis < 3; ++axis) {
        // Column major; rounded to float as in the official code.
        const auto bound = [&](int row) {
            return double{static_cast<float>(box.numbers[2 * axis + row])};
        };
        out.lower[axis] = bound(0), out.upper[axis] = bound(1);
        if (!(out.lower[axis] <= out.upper[axis]))
            throw input_error("E_MAT: ", path, ": BB is not a box");
    }
    out.voxel = size.numbers[0];
    return out;
}

/// Indices of the views whose masks are used: "all", "first:N" or a list.
std::vector<std::size_t> culling_views(const std::string& choice, std::size_t count) {
    std::vector<std::size_t> views;
    const bool first = choice.starts_with("first:");
    if (choice == "all" || first) {
        std::size_t n = count;
        if (first && (!parse_number(choice.substr(6), n) || n < 1 || n > count))
            throw Error(ExitCode::usage, "--cull ", choice, ": expected first:1 to first:", count);
        views.resize(n);
        std::iota(views.begin(), views.end(), 0);
        return views;
    }
    for (std::size_t at = 0, comma; at <= choice.size(); at = comma + 1) {
        comma = std::min(choice.find(',', at), choice.size());
        std::size_t view = 0;
        if (!parse_number(choice.substr(at, comma - at), view) || view >= count)
            throw Error(ExitCode::usage, "--cull ", choice,
                        ": expected all, first:N, none or views by number, "
                        "0 to ",
                        count - 1);
        views.push_back(view);
    }
    return views;
}

}  // namespace

DtuTruth read_dtu_truth(const std::string& folder, int scan) {
    DtuTruth truth;
    truth.points = read_truth(find_in(folder, scan, stl_name(scan)), distribution(scan));
    truth.mask = read_mask(find_in(folder, scan, str("ObsMask/ObsMask", scan, "_10.mat")));
    const std::string path = find_in(folder, scan, str("ObsMask/Plane", scan, ".mat"));
    const MatArray plane = read_mat_array(path, "P");
    if (plane.numbers.size() != 4)
        throw input_error("E_MAT: ", path, ": P has ", plane.numbers.size(),
                          " numbers, expected the 4 of a plane");
    truth.plane.emplace();
    std::ranges::copy(plane.numbers, truth.plane->begin());
    return truth;
}

std::string find_dtu_cameras(const std::string& cameras, const std::string& masks) {
    if (!cameras.empty()) return cameras;
    if (masks.empty()) return "";
    for (const char* name : {"cameras.npz", "cameras_sphere.npz"})
        for (const fs::path& folder : {fs::path(masks).parent_path(), fs::path(masks)})
            if (fs::is_regular_file(folder / name)) return (folder / name).string();
    throw input_error("--cull-masks ", masks,
                      ": no cameras.npz or cameras_sphere.npz in or beside it; "
                      "name the file with --cameras");
}

std::size_t cull_dtu(PreciseMesh& mesh, const NpzCameras& cameras, const DtuCulling& culling) {
    std::vector<std::string> files;
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(culling.masks, error))
        if (entry.path().extension() == ".png") files.push_back(entry.path().string());
    std::ranges::sort(files);
    if (files.size() != cameras.views.size())
        throw input_error("E_MASK_COUNT: ", culling.masks, ": ", files.size(), " PNG files for ",
                          cameras.views.size(), " cameras; masks and cameras must be of one scene");
    std::vector<MaskView> views;
    const std::vector<std::size_t> chosen = culling_views(culling.views, files.size());
    for (const std::size_t i : chosen) {
        const NpzCamera& camera = cameras.views[i];
        views.push_back({{camera.rows[0], camera.rows[1], camera.rows[2]},
                         camera.last,
                         read_image(files[i], 1)});
        const int width = views.back().mask.width;
        if (std::abs(2 * camera.cx_px - width) > 0.2 * width)
            throw input_error("E_MASK_SIZE: ", files[i], ": ", width,
                              " pixels wide, but the principal point of its camera is at ",
                              camera.cx_px, "; expected masks of the size of the photographs");
    }
    const std::size_t before = mesh.vertices.size();
    const std::vector<std::size_t> removed = cull_by_masks(mesh, views, culling.dilate_px);
    if (before > 0 && mesh.vertices.empty()) {
        const auto most = std::ranges::max_element(removed) - removed.begin();
        throw input_error("E_CULL_ALL: the masks removed all ", grouped(before), " vertices; view ",
                          chosen[most], " alone removed ", grouped(removed[most]),
                          "; check --cameras, --mesh-units and the order of the masks");
    }
    return before - mesh.vertices.size();
}

bool to_millimetres(PreciseMesh& mesh, const NpzCameras* cameras, const std::string& units) {
    const PointBounds box = bounds_of(mesh.vertices);
    const double size = norm(box.upper - box.lower);
    const bool normalised =
        units == "normalised" || (units == "auto" && cameras && size < 20 && cameras->scale > 20);
    if (normalised && !cameras)
        throw Error(ExitCode::usage,
                    "--mesh-units normalised: needs --cameras FILE, the file with scale_mat_0");
    if (units == "auto")
        spdlog::info("The prediction spans {:.6g} units: read as {}", size,
                     normalised ? "normalised, scaled by scale_mat_0" : "millimetres");
    if (normalised)
        for (Vec3d& p : mesh.vertices) p = cameras->scale * p + cameras->offset;
    return normalised;
}

}  // namespace tvsgs
