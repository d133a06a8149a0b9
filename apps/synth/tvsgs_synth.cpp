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
        throw Error(ExitCode::usage, str("--test-views ", *options.test_views, ": ", options.views,
                                         " views leave fewer than two to train; expected at most ",
                                         options.views - 2, ", or more --views"));
    check_priors(options.priors);
    if (options.lens != "PINHOLE" && !options.priors.format.empty())
        throw Error(ExitCode::usage, "--lens and --priors: priors are made for PINHOLE alone");
    make_shape(options.shape);  // reports a wrong name before writing anything
    if (options.wide > 0 && options.shininess > 0)
        throw Error(ExitCode::usage, "--wide and --shininess: the wide scene has no highlights");
    const fs::path out = fs::path(options.out).lexically_normal();
    std::error_code failure;
    if (fs::exists(out, failure) &&
        !(fs::is_directory(out, failure) && fs::is_empty(out, failure))) {
        if (!options.overwrite)
            throw Error(
                ExitCode::usage,
                str("--out ", options.out,
                    ": exists and is not an empty folder; choose another or pass --overwrite"));
        if (!has_manifest(out) || !fs::exists(out / "gt/info.json") ||
            !fs::exists(out / "splits.json"))
            throw Error(ExitCode::usage,
                        str("--out ", options.out,
                            ": holds something else than a scene of tvsgs-synth; not overwritten"));
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
                    throw Error(ExitCode::usage, str(target, "/", file.string(),
                                                     ": is there, and not written by tvsgs; move "
                                                     "it away, or name another folder"));
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
            throw Error(ExitCode::io, str(target, ": cannot be written: ", failure.message()));
        fs::remove_all(partial, failure);
    };
    const SignalGuard signals;
    try {
        fs::create_directories(partial, failure);
        if (failure)
            throw Error(ExitCode::io, str(partial, ": cannot be made: ", failure.message()));
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
    CLI::App app(
        "Writes a small scene with exact ground truth: photographs, cameras, masks, surface.",
        "tvsgs-synth");
    app.add_option("-o,--out", options.out, "folder to write")->required();
    app.add_option("--shape", options.shape, "bust, spheres or torus")->capture_default_str();
    app.add_option("--wide", options.wide,
                   "in place of one object many, on a ground with relief of so many units a side, "
                   "seen from two heights [12]")
        ->expected(0, 1)
        ->default_str("12")
        ->check(in_range(4.0, 200.0));
    app.add_option("--views", options.views, "number of views")
        ->check(CLI::Range(2, 9999))
        ->capture_default_str();
    app.add_option("--width", options.width, "pixels")
        ->check(CLI::Range(16, 4096))
        ->capture_default_str();
    app.add_option("--height", options.height, "pixels")
        ->check(CLI::Range(16, 4096))
        ->capture_default_str();
    app.add_option("--test-views", options.test_views,
                   "number of --views that only test, evenly between the first and the last; "
                   "default: every eighth view")
        ->check(CLI::Range(0, 9997));
    app.add_option("--arc", options.arc_deg, "degrees of azimuth covered; 360: a ring")
        ->check(in_range(1.0, 360.0))
        ->capture_default_str();
    app.add_option("--elevation-span", options.elevation_span_deg,
                   "degrees between the lowest and the highest of the cameras' three elevations")
        ->check(in_range(0.0, 56.0))  // 4 to 60 degrees: above the ground disc's edge
        ->capture_default_str();
    app.add_option("--points", options.points,
                   "surface samples for points3D.txt; it gets those that two views see")
        ->check(CLI::Range(0, 2000000))
        ->capture_default_str();
    app.add_option("--texture", options.texture,
                   "contrast of the surface's own colours; 0: one grey, shaded")
        ->check(in_range(0.0, 1.0))
        ->capture_default_str();
    app.add_option("--shininess", options.shininess,
                   "strength of the highlights, which move with the view; 0: none, 1: up to white")
        ->check(in_range(0.0, 4.0))
        ->capture_default_str();
    app.add_option("--background", options.background,
                   "empty (black); sky: textured, infinitely far away, without points; white: "
                   "overexposed; noise: greys that no two views share")
        ->check(CLI::IsMember({"empty", "sky", "white", "noise"}))
        ->capture_default_str();
    app.add_flag("--masks,!--no-masks", options.masks,
                 "masks of object and ground disc; written unless --no-masks");
    std::vector<std::string> lenses;
    for (const auto& [name, coefficients] : kLenses) lenses.push_back(name);
    app.add_option("--lens", options.lens,
                   "camera model of the photographs, with the distortion of a common lens")
        ->check(CLI::IsMember(lenses))
        ->capture_default_str();
    app.add_option("--exposure-drift", options.exposure_drift,
                   "each view is brighter or darker by up to this share; gt/info.json says by how "
                   "much")
        ->check(in_range(0.0, 0.9))
        ->capture_default_str();
    app.add_option("--pose-noise", options.pose_noise,
                   "the poses of the views that train are off, by about that many pixels; "
                   "gt/sparse has the exact ones")
        ->check(in_range(0.0, 100.0))
        ->capture_default_str();
    app.add_option("--noise", options.noise,
                   "standard deviation of the sensor noise, in 8-bit steps")
        ->check(in_range(0.0, 100.0))
        ->capture_default_str();
    SynthPriors& priors = options.priors;
    app.add_option("--priors", priors.format, "exact depth and normals as another program has them")
        ->check(CLI::IsMember(kPriorFormats));
    const CLI::IsMember quantities({"depth", "inverse_depth", "log_depth"});
    app.add_option("--prior-quantity", priors.quantity,
                   "with npy, vggt, omnidata or json: what the numbers of the depth maps are")
        ->check(quantities)
        ->capture_default_str();
    app.add_option("--prior-declare", priors.declare, "with json: the quantity that it claims")
        ->check(quantities);
    app.add_flag("--prior-ray", priors.ray, "depth along the ray instead of the optical axis");
    app.add_option("--prior-scale", priors.scale, "depths are that many times too large")
        ->check(in_range(1e-3, 1e3))
        ->capture_default_str();
    app.add_option("--prior-noise", priors.noise, "standard deviation, as a share of the depth")
        ->check(in_range(0.0, 1.0))
        ->capture_default_str();
    app.add_option("--prior-holes", priors.holes, "share of the blocks of 8 pixels without a value")
        ->check(in_range(0.0, 1.0))
        ->capture_default_str();
    app.add_option("--prior-normals", priors.frame, "frame of the normals")
        ->check(CLI::IsMember({"camera_opencv", "camera_opengl", "world"}))
        ->capture_default_str();
    app.add_flag("--prior-normals-away", priors.normals_away, "normals that face away");
    app.add_option("--seed", options.seed, "texture, samples and noise")->capture_default_str();
    app.add_flag("--overwrite", options.overwrite, "replace an earlier scene");
    app.add_flag("--quiet", quiet, "warnings and errors only");
    parse_command_line(app, argc, argv);
    init_log(quiet ? Verbosity::quiet : Verbosity::normal);
    const int code = run(options);
    say_next({"tvsgs-train", "--scene", options.out}, "trains on it");
    return code;
}

}  // namespace
}  // namespace tvsgs

int main(int argc, char** argv) {
    return tvsgs::run_command([&] { return tvsgs::command(argc, argv); });
}
