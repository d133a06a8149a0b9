// tvsgs-eval dtu: the official DTU evaluation.  docs/evaluation.md
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>

#include "apps/eval/input.h"
#include "apps/eval/subcommands.h"
#include "eval/dtu_protocol.h"
#include "eval/frame_check.h"
#include "io/image_file.h"
#include "io/manifest.h"
#include "io/mat_file.h"
#include "io/npz_cameras.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

struct DtuArguments {
    std::string pred, dtu, cameras, units = "auto", mode = "auto", masks, cull = "all",
                                    order = "seeded", clouds, palette, out;
    int scan = 0, dilate = 24;
    double min_opacity = 0;
    std::uint64_t seed = 0;
    bool force = false;
    DtuOptions options;
    std::vector<std::string> require;
};

/// Path of the truth below the evaluation set.
std::string stl_name(int scan) {
    char name[40];
    std::snprintf(name, sizeof name, "Points/stl/stl%03d_total.ply", scan);
    return name;
}

std::string distribution(int scan) {
    return str("  expected DIR/", stl_name(scan), ", DIR/ObsMask/ObsMask", scan,
               "_10.mat and DIR/ObsMask/Plane", scan,
               ".mat\n  (or the same below 'DIR/SampleSet/MVS Data'); the benchmark distributes "
               "them as Points.zip and SampleSet.zip at "
               "https://roboimagedata.compute.dtu.dk/?page_id=36");
}

/// A file of the evaluation set, in one of the two places where people unpack it.
std::string find_in(const DtuArguments& a, const std::string& name) {
    for (const char* below : {"", "SampleSet/MVS Data"}) {
        const std::string path = (fs::path(a.dtu) / below / name).string();
        std::error_code error;
        if (fs::is_regular_file(path, error)) return path;
    }
    throw Error(ExitCode::input,
                str((fs::path(a.dtu) / name).string(), ": no such file\n", distribution(a.scan)));
}

ObservationMask read_mask(const std::string& path) {
    const MatArray mask = read_mat_array(path, "ObsMask"), box = read_mat_array(path, "BB"),
                   size = read_mat_array(path, "Res");
    const bool fits = mask.shape.size() == 3 && box.shape == std::vector<std::int64_t>{2, 3} &&
                      size.numbers.size() == 1 && size.numbers[0] > 0;
    if (!fits)
        throw Error(ExitCode::input, str("E_MAT: ", path,
                                         ": expected ObsMask in three dimensions, BB 2x3 and one "
                                         "positive number Res"));
    ObservationMask out;
    out.nx = static_cast<int>(mask.shape[0]), out.ny = static_cast<int>(mask.shape[1]),
    out.nz = static_cast<int>(mask.shape[2]);
    out.seen.resize(mask.numbers.size());
    for (std::size_t i = 0; i < out.seen.size(); ++i) out.seen[i] = mask.numbers[i] != 0;
    for (int axis = 0; axis < 3; ++axis) {
        // Column major; and rounded to float, as in the official code.
        const auto at = 2 * static_cast<std::size_t>(axis);
        out.lower[axis] = static_cast<double>(static_cast<float>(box.numbers[at]));
        out.upper[axis] = static_cast<double>(static_cast<float>(box.numbers[at + 1]));
        if (!(out.lower[axis] <= out.upper[axis]))
            throw Error(ExitCode::input, str("E_MAT: ", path, ": BB is no box"));
    }
    out.voxel = size.numbers[0];
    return out;
}

DtuTruth read_dtu_truth(const DtuArguments& a) {
    DtuTruth truth;
    truth.points = read_truth(find_in(a, stl_name(a.scan)), distribution(a.scan));
    truth.mask = read_mask(find_in(a, str("ObsMask/ObsMask", a.scan, "_10.mat")));
    const std::string path = find_in(a, str("ObsMask/Plane", a.scan, ".mat"));
    const MatArray plane = read_mat_array(path, "P");
    if (plane.numbers.size() != 4)
        throw Error(ExitCode::input, str("E_MAT: ", path, ": P has ", plane.numbers.size(),
                                         " numbers, expected the 4 of a plane"));
    truth.plane.emplace();
    std::copy(plane.numbers.begin(), plane.numbers.end(), truth.plane->begin());
    return truth;
}

/// cameras.npz, as the published evaluations read, or cameras_sphere.npz beside the masks.
std::string find_cameras(const DtuArguments& a) {
    if (!a.cameras.empty()) return a.cameras;
    if (a.masks.empty()) return "";
    for (const char* name : {"cameras.npz", "cameras_sphere.npz"})
        for (const fs::path& folder : {fs::path(a.masks).parent_path(), fs::path(a.masks)})
            if (fs::is_regular_file(folder / name)) return (folder / name).string();
    throw Error(ExitCode::input, str("--cull-masks ", a.masks,
                                     ": no cameras.npz or cameras_sphere.npz in or beside it; "
                                     "name the file with --cameras"));
}

/// Indices of the views whose masks cull: "all", "first:N" or a list.
std::vector<std::size_t> culling_views(const std::string& choice, std::size_t count) {
    std::vector<std::size_t> views;
    if (choice == "none") return views;
    const bool first = choice.starts_with("first:");
    if (choice == "all" || first) {
        std::size_t n = count;
        const char* const end = choice.data() + choice.size();
        if (first) {
            const auto [rest, code] = std::from_chars(choice.data() + 6, end, n);
            if (code != std::errc{} || rest != end || n < 1 || n > count)
                throw Error(ExitCode::usage,
                            str("--cull ", choice, ": expected first:1 to first:", count));
        }
        for (std::size_t i = 0; i < n; ++i) views.push_back(i);
        return views;
    }
    const char* at = choice.data();
    const char* const end = at + choice.size();
    while (at <= end) {
        std::size_t view = 0;
        const auto [rest, code] = std::from_chars(at, end, view);
        if (code != std::errc{} || (rest != end && *rest != ',') || view >= count)
            throw Error(ExitCode::usage, str("--cull ", choice,
                                             ": expected all, first:N, none or views by number, "
                                             "0 to ",
                                             count - 1));
        views.push_back(view);
        at = rest + 1;
    }
    return views;
}

/// Culls by the masks in a folder, whose sorted files belong to the cameras in order.
std::size_t cull(PreciseMesh& mesh, const NpzCameras& cameras, const DtuArguments& a) {
    std::vector<std::string> files;
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(a.masks, error))
        if (entry.path().extension() == ".png") files.push_back(entry.path().string());
    std::sort(files.begin(), files.end());
    if (files.size() != cameras.views.size())
        throw Error(ExitCode::input, str("E_MASK_COUNT: ", a.masks, ": ", files.size(),
                                         " PNG files for ", cameras.views.size(),
                                         " cameras; masks and cameras must be those of one scene"));
    std::vector<MaskView> views;
    const std::vector<std::size_t> chosen = culling_views(a.cull, files.size());
    for (const std::size_t i : chosen) {
        const NpzCamera& camera = cameras.views[i];
        views.push_back({{camera.rows[0], camera.rows[1], camera.rows[2]},
                         camera.last,
                         read_image(files[i], 1)});
        const int width = views.back().mask.width;
        if (std::abs(2 * camera.cx_px - width) > 0.2 * width)
            throw Error(
                ExitCode::input,
                str("E_MASK_SIZE: ", files[i], ": ", width,
                    " pixels wide, but the principal point of its camera is at ", camera.cx_px,
                    "; expected masks of the size the cameras were made for"));
    }
    const std::size_t before = mesh.vertices.size();
    const std::vector<std::size_t> removed = cull_by_masks(mesh, views, a.dilate);
    if (before > 0 && mesh.vertices.empty()) {
        const auto most = std::max_element(removed.begin(), removed.end()) - removed.begin();
        throw Error(ExitCode::input,
                    str("E_CULL_ALL: 0 of ", before, " vertices left; view ",
                        chosen[static_cast<std::size_t>(most)], " alone removed ",
                        removed[static_cast<std::size_t>(most)],
                        " (check --cameras, --mesh-units and the order of the masks)"));
    }
    return before - mesh.vertices.size();
}

double diagonal(const std::vector<Vec3d>& points) {
    Vec3d lower = points[0], upper = points[0];
    for (const Vec3d p : points)
        for (int axis = 0; axis < 3; ++axis) {
            lower[axis] = std::min(lower[axis], p[axis]);
            upper[axis] = std::max(upper[axis], p[axis]);
        }
    return norm(upper - lower);
}

/// To millimetres; says whether the prediction was normalised.
bool to_millimetres(PreciseMesh& mesh, const NpzCameras* cameras, const DtuArguments& a) {
    const double size = diagonal(mesh.vertices);
    const bool normalised = a.units == "normalised" ||
                            (a.units == "auto" && cameras && size < 20 && cameras->scale > 20);
    if (normalised && !cameras)
        throw Error(ExitCode::usage,
                    "--mesh-units normalised: name the file with scale_mat_0 with --cameras");
    if (a.units == "auto")
        spdlog::info("the prediction spans {:.6g} units: taken as {}", size,
                     normalised ? "normalised, and scaled by scale_mat_0" : "millimetres");
    if (normalised)
        for (Vec3d& p : mesh.vertices) p = cameras->scale * p + cameras->offset;
    return normalised;
}

std::string counts_json(const Prediction& in, std::size_t culled, const DtuMetrics& m) {
    JsonLine json;
    json.add("vertices", static_cast<std::int64_t>(in.vertices))
        .add("faces", static_cast<std::int64_t>(in.faces))
        .add("dropped_not_finite", static_cast<std::int64_t>(in.dropped))
        .add("dropped_transparent", static_cast<std::int64_t>(in.transparent))
        .add("culled", static_cast<std::int64_t>(culled))
        .add("sampled", m.sampled)
        .add("thinned", m.thinned)
        .add("in_box", m.in_box)
        .add("observed", m.observed)
        .add("accuracy_outliers", m.accuracy_outliers)
        .add("gt", m.truth)
        .add("gt_above_plane", m.truth_above)
        .add("completeness_outliers", m.completeness_outliers);
    return json.text();
}

int dtu(const DtuArguments& a) {
    const std::vector<Bound> bounds = parse_bounds(a.require);
    DtuOptions options = a.options;
    if (a.order == "given")
        options.seed.reset();
    else
        options.seed = a.seed;

    // 1. Read, to millimetres, cull.
    const DtuTruth truth = read_dtu_truth(a);
    Prediction in = read_prediction(a.pred, a.min_opacity);
    const std::string camera_file = find_cameras(a);
    std::optional<NpzCameras> cameras;
    if (!camera_file.empty()) cameras = read_npz_cameras(camera_file);
    const bool normalised = to_millimetres(in.mesh, cameras ? &*cameras : nullptr, a);
    if (const FrameCheck frame = check_frame(in.mesh.vertices, truth.points);
        !frame.plausible() && !a.force)
        throw Error(ExitCode::input,
                    str("E_DTU_FRAME: ", a.pred, " is not in the frame of scan ", a.scan, ": ",
                        frame.text(),
                        "; was scale_mat applied twice or not at all? (--cameras FILE --mesh-units "
                        "normalised; --force measures regardless)"));
    const bool culling = !a.masks.empty() && a.cull != "none";
    const std::size_t culled = culling ? cull(in.mesh, *cameras, a) : 0;

    // 2. Measure.
    bool sample = a.mode != "points" && !in.is_splats;
    if (sample && in.mesh.faces.empty()) {
        if (a.mode == "mesh" || in.faces > 0)
            spdlog::warn("{}: no face to sample; its vertices are measured as points", a.pred);
        sample = false;
    }
    DtuMetrics m = evaluate_dtu(
        sample ? sample_dtu(in.mesh.vertices, in.mesh.faces, options) : in.mesh.vertices, truth,
        options);

    // 3. Report.
    JsonLine protocol;
    protocol.add("measured", sample         ? "mesh"
                             : in.is_splats ? "splat centres"
                                            : "points")
        .add("spacing", options.spacing)
        .add("max_distance", options.max_distance)
        .add("order", a.order);
    if (options.seed) protocol.add("seed", static_cast<std::int64_t>(*options.seed));
    protocol.add("units", normalised ? "normalised, scaled by scale_mat_0" : "mm")
        .add("cull", culling ? a.cull : "none");
    if (culling) protocol.add("cull_dilate_px", a.dilate);
    if (in.is_splats) protocol.add("min_opacity", a.min_opacity);
    JsonLine inputs;
    inputs.add("pred", a.pred).add("dtu", a.dtu).add("scan", a.scan);
    if (cameras) inputs.add("cameras", camera_file);
    if (culling) inputs.add("masks", a.masks);
    const std::vector<Metric> metrics = {{"accuracy", m.accuracy},
                                         {"completeness", m.completeness},
                                         {"chamfer", m.overall},
                                         {"median_accuracy", m.accuracy_median},
                                         {"median_completeness", m.completeness_median}};
    JsonLine json;
    for (const Metric& metric : metrics) json.add(metric.key, metric.value);
    json.add_json("points", counts_json(in, culled, m))
        .add_json("protocol", protocol.text())
        .add_json("inputs", inputs.text());
    if (!a.clouds.empty()) list_results(a.clouds, {"accuracy.ply", "completeness.ply"});
    put_report(json.text(), a.out);
    if (!m.undefined.empty())
        throw Error(ExitCode::input, str("E_DTU_EMPTY: scan ", a.scan, ": ", m.undefined,
                                         ", so that the metrics are undefined"));
    if (!a.clouds.empty()) {
        constexpr double kFull = 10;  // mm, as the official pictures
        const ErrorPalette palette = find_palette(a.palette, ErrorPalette::dtu);
        write_error_cloud(a.clouds + "/accuracy.ply", m.prediction, palette, kFull);
        write_error_cloud(a.clouds + "/completeness.ply", m.reference, palette, kFull);
    }
    return check_bounds(bounds, metrics);
}

}  // namespace

EvalCommand add_eval_dtu(CLI::App& app) {
    const auto arguments = std::make_shared<DtuArguments>();
    DtuArguments& a = *arguments;
    CLI::App* command = app.add_subcommand("dtu", "the evaluation of the DTU benchmark, in mm");
    command->add_option("--pred", a.pred, "mesh, cloud or splats (PLY)")->required();
    command->add_option("--scan", a.scan, "number of the scan")
        ->required()
        ->check(CLI::Range(1, 9999));
    command->add_option("--dtu", a.dtu, "folder with Points/ and ObsMask/")->required();
    command->add_option("--cameras", a.cameras, "cameras.npz with scale_mat_0 [beside the masks]");
    command->add_option("--mesh-units", a.units, "auto, mm or normalised [auto]")
        ->check(CLI::IsMember({"auto", "mm", "normalised"}));
    command->add_option("--mode", a.mode, "auto, mesh or points [auto: by the file]")
        ->check(CLI::IsMember({"auto", "mesh", "points"}));
    command->add_option("--cull-masks", a.masks, "cull by the object masks in this folder");
    command->add_option("--cull", a.cull,
                        "views whose masks cull: all, first:N, none or I,J,K [all]");
    command->add_option("--cull-dilate", a.dilate, "pixels by which the masks grow [24]")
        ->check(CLI::Range(0, 200));
    command->add_option("--min-opacity", a.min_opacity, "leaves fainter splats out [0: none]")
        ->check(CLI::Range(0.0, 1.0));
    command->add_option("--seed", a.seed, "of the thinning's order [0]");
    command->add_option("--order", a.order, "of the thinning: seeded or given [seeded]")
        ->check(CLI::IsMember({"seeded", "given"}));
    command->add_option("--spacing", a.options.spacing, "of samples and thinning, mm [0.2]")
        ->check(kPositive);
    command->add_option("--max-distance", a.options.max_distance, "outliers begin here, mm [20]")
        ->check(kPositive);
    command->add_option("--max-samples", a.options.max_samples, "of the mesh [100000000]")
        ->check(CLI::Range(std::int64_t{1}, std::int64_t{2000000000}));
    command->add_option("--clouds", a.clouds, "folder for clouds coloured by error");
    command->add_option("--palette", a.palette, "of the clouds: dtu, tnt or safe [dtu]")
        ->check(CLI::IsMember({"dtu", "tnt", "safe"}));
    command->add_flag("--force", a.force, "measure even what seems to be in another frame");
    add_output_flag(*command, "--out", a.out, "JSON file to write as well");
    add_require(*command, a.require, "chamfer<=1.5");
    return {command, [arguments] { return dtu(*arguments); }};
}

}  // namespace tvsgs
