// tvsgs-synth: writes a small scene with exact ground truth.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <filesystem>

#include "apps/common/command_line.h"
#include "apps/synth/lens.h"
#include "apps/synth/object.h"
#include "apps/synth/views.h"
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

void run(const SynthOptions& options) {
    if (options.test_views.value_or(0) > options.views - 2)
        throw usage_error("--test-views ", *options.test_views, ": ", options.views,
                          " views would leave fewer than two for training; give at most ",
                          options.views - 2, ", or more --views");
    if (options.lens != "PINHOLE" && !options.priors.format.empty())
        throw usage_error("--lens and --priors exclude each other: priors need PINHOLE");
    const fs::path out = fs::path(options.out).lexically_normal();
    std::error_code failure;
    if (fs::exists(out, failure) &&
        !(fs::is_directory(out, failure) && fs::is_empty(out, failure))) {
        if (!options.overwrite)
            throw usage_error(
                "--out ", options.out,
                ": already exists and is not empty; choose another folder, or --overwrite");
        if (!has_manifest(out) || !fs::exists(out / "gt/info.json") ||
            !fs::exists(out / "splits.json"))
            throw usage_error("--out ", options.out,
                              ": not a scene of tvsgs-synth; choose another folder");
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
                    throw usage_error(target, "/", file.string(),
                                      ": already exists and is not ours; choose another folder");
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
        if (failure) throw Error(ExitCode::io, target, ": cannot write it: ", failure.message());
        fs::remove_all(partial, failure);
    };
    const SignalGuard signals;
    try {
        fs::create_directories(partial, failure);
        if (failure) throw Error(ExitCode::io, partial, ": cannot make it: ", failure.message());
        start_manifest(partial);
        write_scene(options, partial);
        move_in_place();
    } catch (...) {
        fs::remove_all(partial, failure);
        throw;
    }
}

}  // namespace

int command(int argc, char** argv) {
    SynthOptions options;
    CLI::App app("Writes a small scene with exact truth: photographs, cameras, masks, surface.",
                 "tvsgs-synth");
    app.add_option("-o,--out", options.out, "folder to write")->required();
    add_choice(app, "--shape", options.shape, {"bust", "spheres", "torus"}, "the object");
    app.add_option("--wide", options.wide,
                   "many objects instead of one, on a ground with relief, N units wide, seen from "
                   "two heights [12]")
        ->expected(0, 1)
        ->default_str("12")
        ->check(in_range(4.0, 200.0));
    add_number(app, "--views", options.views, 2, 9999, "number of photographs");
    add_number(app, "--width", options.width, 16, 4096, "width of the photographs, pixels");
    add_number(app, "--height", options.height, 16, 4096, "height of the photographs, pixels");
    app.add_option("--test-views", options.test_views,
                   "test views among --views, evenly spaced [every eighth view]")
        ->check(CLI::Range(0, 9997));
    add_number(app, "--arc", options.arc_deg, 1.0, 360.0,
               "azimuth that the cameras cover, degrees; 360: a ring");
    // 4 to 60 degrees: above the ground disc's edge
    add_number(app, "--elevation-span", options.elevation_span_deg, 0.0, 56.0,
               "degrees between the lowest and highest of three camera elevations");
    add_number(app, "--points", options.points, 0, 2000000,
               "surface samples; points3D.txt gets the ones that two views see");
    add_number(app, "--texture", options.texture, 0.0, 1.0,
               "contrast of the surface colours, 0 to 1; 0: one grey, shaded");
    add_number(app, "--shininess", options.shininess, 0.0, 4.0,
               "strength of highlights, which move with the view; 0: none, 1: up to white")
        ->excludes("--wide");  // the wide scene has no highlights
    add_choice(app, "--background", options.background, {"empty", "sky", "white", "noise"},
               "empty: black; sky: textured, infinitely far, without points; white: overexposed; "
               "noise: other greys in each view");
    app.add_flag("--masks,!--no-masks", options.masks,
                 "write masks of object and ground disc, or do not [written]");
    std::vector<std::string> lenses;
    for (const auto& [name, coefficients] : kLenses) lenses.push_back(name);
    app.add_option("--lens", options.lens, "camera model, with the distortion of a common lens")
        ->check(CLI::IsMember(lenses));
    add_number(
        app, "--exposure-drift", options.exposure_drift, 0.0, 0.9,
        "largest change of brightness between photographs, as a share; gt/info.json lists it");
    add_number(app, "--pose-noise", options.pose_noise, 0.0, 100.0,
               "error of the training poses, pixels; gt/sparse has the exact poses");
    add_number(app, "--noise", options.noise, 0.0, 100.0,
               "standard deviation of the sensor noise, in 8-bit steps");
    app.add_option("--priors", options.priors.format,
                   "write exact depth and normals in the format of another program")
        ->check(CLI::IsMember(kPriorFormats));
    app.add_option("--seed", options.seed, "seed of texture, samples and noise");
    app.add_flag("--overwrite", options.overwrite, "replace an earlier scene");
    add_log_flags(app);
    parse_command_line(app, argc, argv);
    run(options);
    say_next({"tvsgs-train", "--scene", options.out, "--split", "train_all"},
             "train on all views but the test views");
    return 0;
}

}  // namespace tvsgs
