// tvsgs-synth: writes a small scene with exact ground truth.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <filesystem>

#include "apps/common/command_line.h"
#include "apps/synth/lens.h"
#include "apps/synth/object.h"
#include "apps/synth/priors.h"
#include "apps/synth/scene.h"
#include "io/files/manifest.h"
#include "pipeline/run/signals.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using namespace synth;

/// All files below a folder, as relative paths.
std::vector<fs::path> files_below(const fs::path& folder) {
    std::vector<fs::path> files;
    for (const auto& entry : fs::recursive_directory_iterator(folder))
        if (entry.is_regular_file()) files.push_back(entry.path().lexically_relative(folder));
    return files;
}

int run(const SynthOptions& options) {
    if (options.test_views.value_or(0) > options.views - 2)
        throw Error(ExitCode::usage,
                    str("--test-views ", *options.test_views, ": ", options.views,
                        " views would leave fewer than two for training; give at most ",
                        options.views - 2, ", or more --views"));
    check_priors(options.priors);
    if (options.lens != "PINHOLE" && !options.priors.format.empty())
        throw Error(ExitCode::usage, "--lens and --priors exclude each other: priors need PINHOLE");
    make_shape(options.shape);  // reports a wrong name before writing anything
    if (options.wide > 0 && options.shininess > 0)
        throw Error(ExitCode::usage,
                    "--wide and --shininess exclude each other: the wide scene has no highlights");
    const fs::path out = fs::path(options.out).lexically_normal();
    std::error_code failure;
    if (fs::exists(out, failure) &&
        !(fs::is_directory(out, failure) && fs::is_empty(out, failure))) {
        if (!options.overwrite)
            throw Error(
                ExitCode::usage,
                str("--out ", options.out,
                    ": already exists and is not empty; choose another folder, or --overwrite"));
        if (!has_manifest(out) || !fs::exists(out / "gt/info.json") ||
            !fs::exists(out / "splits.json"))
            throw Error(
                ExitCode::usage,
                str("--out ", options.out, ": not a scene of tvsgs-synth; choose another folder"));
    }
    // Completes the scene before it gets its name.
    std::string target = out.string();
    while (target.size() > 1 && target.back() == '/') target.pop_back();
    const std::string partial = str(target, ".partial-", ::getpid());
    // Keeps files that the user added to an earlier scene.
    const auto move_in_place = [&] {
        if (has_manifest(target)) {
            for (const fs::path& file : files_below(partial))
                if (fs::exists(target / file, failure) && file.native() != kManifestName &&
                    !is_listed(target, target / file))
                    throw Error(ExitCode::usage,
                                str(target, "/", file.string(),
                                    ": already exists and is not ours; choose another folder"));
            remove_listed_files(target);
        }
        failure.clear();
        if (!fs::exists(target, failure) || fs::is_empty(target, failure)) {
            fs::remove(target, failure);
            fs::rename(partial, target, failure);
        } else {
            for (const fs::path& file : files_below(partial)) {
                fs::create_directories((target / file).parent_path(), failure);
                if (!failure) fs::rename(partial / file, target / file, failure);
                if (failure) break;
            }
        }
        if (failure)
            throw Error(ExitCode::io, str(target, ": cannot write it: ", failure.message()));
        fs::remove_all(partial, failure);
    };
    const SignalGuard signals;
    try {
        fs::create_directories(partial, failure);
        if (failure)
            throw Error(ExitCode::io, str(partial, ": cannot make it: ", failure.message()));
        start_manifest(partial);
        write_scene(options, partial);
        move_in_place();
    } catch (...) {
        fs::remove_all(partial, failure);
        throw;
    }
    return static_cast<int>(ExitCode::done);
}

int command(int argc, char** argv) {
    SynthOptions options;
    bool quiet = false;
    CLI::App app("Writes a small scene with exact truth: photographs, cameras, masks, surface.",
                 "tvsgs-synth");
    app.add_option("-o,--out", options.out, "folder to write")->required();
    app.add_option("--shape", options.shape, "object: bust, spheres or torus")
        ->capture_default_str();
    app.add_option("--wide", options.wide,
                   "many objects instead of one, on a ground with relief, N units wide, seen from "
                   "two heights [12]")
        ->expected(0, 1)
        ->default_str("12")
        ->check(in_range(4.0, 200.0));
    app.add_option("--views", options.views, "number of photographs")
        ->check(CLI::Range(2, 9999))
        ->capture_default_str();
    app.add_option("--width", options.width, "width of the photographs, pixels")
        ->check(CLI::Range(16, 4096))
        ->capture_default_str();
    app.add_option("--height", options.height, "height of the photographs, pixels")
        ->check(CLI::Range(16, 4096))
        ->capture_default_str();
    app.add_option("--test-views", options.test_views,
                   "test views among --views, evenly spaced [every eighth view]")
        ->check(CLI::Range(0, 9997));
    app.add_option("--arc", options.arc_deg, "azimuth that the cameras cover, degrees; 360: a ring")
        ->check(in_range(1.0, 360.0))
        ->capture_default_str();
    app.add_option("--elevation-span", options.elevation_span_deg,
                   "degrees between the lowest and highest of three camera elevations")
        ->check(in_range(0.0, 56.0))  // 4 to 60 degrees: above the ground disc's edge
        ->capture_default_str();
    app.add_option("--points", options.points,
                   "surface samples; points3D.txt gets the ones that two views see")
        ->check(CLI::Range(0, 2000000))
        ->capture_default_str();
    app.add_option("--texture", options.texture,
                   "contrast of the surface colours, 0 to 1; 0: one grey, shaded")
        ->check(in_range(0.0, 1.0))
        ->capture_default_str();
    app.add_option("--shininess", options.shininess,
                   "strength of highlights, which move with the view; 0: none, 1: up to white")
        ->check(in_range(0.0, 4.0))
        ->capture_default_str();
    app.add_option("--background", options.background,
                   "empty: black; sky: textured, infinitely far, without points; white: "
                   "overexposed; noise: other greys in each view")
        ->check(CLI::IsMember({"empty", "sky", "white", "noise"}))
        ->capture_default_str();
    app.add_flag("--masks,!--no-masks", options.masks,
                 "write masks of object and ground disc, or do not [written]");
    std::vector<std::string> lenses;
    for (const auto& [name, coefficients] : kLenses) lenses.push_back(name);
    app.add_option("--lens", options.lens, "camera model, with the distortion of a common lens")
        ->check(CLI::IsMember(lenses))
        ->capture_default_str();
    app.add_option(
           "--exposure-drift", options.exposure_drift,
           "largest change of brightness between photographs, as a share; gt/info.json lists it")
        ->check(in_range(0.0, 0.9))
        ->capture_default_str();
    app.add_option("--pose-noise", options.pose_noise,
                   "error of the training poses, pixels; gt/sparse has the exact poses")
        ->check(in_range(0.0, 100.0))
        ->capture_default_str();
    app.add_option("--noise", options.noise,
                   "standard deviation of the sensor noise, in 8-bit steps")
        ->check(in_range(0.0, 100.0))
        ->capture_default_str();
    SynthPriors& priors = options.priors;
    app.add_option("--priors", priors.format,
                   "write exact depth and normals in the format of another program")
        ->check(CLI::IsMember(kPriorFormats));
    const CLI::IsMember quantities({"depth", "inverse_depth", "log_depth"});
    app.add_option("--prior-quantity", priors.quantity,
                   "quantity in the depth maps, for npy, vggt, omnidata or json")
        ->check(quantities)
        ->capture_default_str();
    app.add_option("--prior-declare", priors.declare,
                   "quantity that priors.json declares, for json [the true one]")
        ->check(quantities);
    app.add_flag("--prior-ray", priors.ray,
                 "measure depth along the ray, not along the optical axis");
    app.add_option("--prior-scale", priors.scale, "factor by which depths are too large")
        ->check(in_range(1e-3, 1e3))
        ->capture_default_str();
    app.add_option("--prior-noise", priors.noise,
                   "standard deviation of depth noise, as a share of the depth")
        ->check(in_range(0.0, 1.0))
        ->capture_default_str();
    app.add_option("--prior-holes", priors.holes, "share of 8x8 pixel blocks without a value")
        ->check(in_range(0.0, 1.0))
        ->capture_default_str();
    app.add_option("--prior-normals", priors.frame, "frame of the normals")
        ->check(CLI::IsMember({"camera_opencv", "camera_opengl", "world"}))
        ->capture_default_str();
    app.add_flag("--prior-normals-away", priors.normals_away,
                 "make the normals face away from the camera");
    app.add_option("--seed", options.seed, "seed of texture, samples and noise")
        ->capture_default_str();
    app.add_flag("--overwrite", options.overwrite, "replace an earlier scene");
    app.add_flag("--quiet", quiet, "warnings and errors only");
    parse_command_line(app, argc, argv);
    init_log(quiet ? Verbosity::quiet : Verbosity::normal);
    const int code = run(options);
    say_next({"tvsgs-train", "--scene", options.out, "--split", "train_all"},
             "train on all views but the test views");
    return code;
}

}  // namespace
}  // namespace tvsgs

int main(int argc, char** argv) {
    return tvsgs::run_command([&] { return tvsgs::command(argc, argv); });
}
