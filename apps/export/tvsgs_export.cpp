// tvsgs-export: writes splats in a format for viewers and measures the loss of the format.
#include <algorithm>
#include <filesystem>
#include <optional>

#include "apps/common/command_line.h"
#include "apps/common/key_flags.h"
#include "core/device/device_choice.h"
#include "core/grouped.h"
#include "core/scene/scene.h"
#include "io/files/json_value.h"
#include "io/files/read_file.h"
#include "io/scene/georeference.h"
#include "io/splats/splat_errors.h"
#include "io/splats/splat_files.h"
#include "mesh/draw/mesh_render.h"
#include "pipeline/run/run_folder.h"
#include "pipeline/run/run_options.h"
#include "pipeline/run/splat_selection.h"
#include "pipeline/scene/sky.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

struct Arguments {
    std::string input, output, input_frame, frame, box, sh_bits = "8,8", report, device = "auto";
    int spz_version = 3, palette = 0, sh_degree = 3;
    std::int64_t max_splats = 0;
    bool prune_unseen = false, keep_axes = false, no_check = false, json = false;

    SplatFormat format() const { return *splat_format(output); }
    /// Whether the run's scene is required.
    bool needs_views() const {
        return !no_check || prune_unseen || max_splats > 0 ||
               (format() == SplatFormat::glb && !keep_axes);
    }
};

std::optional<SplatFrame> frame_of(const std::string& name) {
    for (const SplatFrame frame : {SplatFrame::rdf, SplatFrame::rub, SplatFrame::luf})
        if (name == info_of(frame).name) return frame;
    return std::nullopt;
}

bool is_run(const std::string& path) {
    std::error_code failure;
    return fs::is_directory(path, failure);
}

/// Refuses a report file that would replace the splats or their origin file.
void check_report(const Arguments& a) {
    if (a.report.empty()) return;
    const std::string input = find_splats(a.input);
    const auto place = [](const std::string& path) {
        std::error_code failure;
        return fs::weakly_canonical(fs::absolute(path), failure);
    };
    for (const std::string& taken : {a.output, origin_file(a.output), input, origin_file(input)}) {
        std::error_code failure;
        if (place(a.report) == place(taken) || fs::equivalent(a.report, taken, failure))
            throw usage_error("--out-report ", a.report, ": the splats use this file, ", taken,
                              "; choose another name");
    }
}

/// Reads the run's configuration, if there is one, for the scene; flags override it.
Arguments parse(int argc, char** argv, Configuration& configuration) {
    Arguments a;
    auto& [options, table] = configuration;
    CLI::App app{"Writes splats in the formats that viewers take.", "tvsgs-export"};
    app.get_formatter()->column_width(46);
    KeyFlags flags(app, table);
    app.add_option("input", a.input, "run folder or splats (.ply, .spz, .sog, .glb)")->required();
    app.add_option("output", a.output, "file to write (.ply, .spz, .sog, .glb)")->required();
    app.add_option("--device", a.device, "auto, cpu, cuda or cuda:N");
    flags.add_config("JSON file over the run's configuration; later ones win");
    add_log_flags(app, Verbosity::verbose);

    start_group(app, "Which splats");
    app.add_option("--bbox", a.box,
                   "keep only splats whose centre is inside this box, x0,y0,z0,x1,y1,z1 in the "
                   "axes of the scene (rdf) [all]");
    add_number(app, "--max-splats", a.max_splats, 0, 2000000000,
               "keep the N splats that contribute most to the views of the run, or the largest "
               "ones without a run [0: all]");
    app.add_flag("--prune-unseen", a.prune_unseen, "remove splats that no view of the run shows");
    add_number(app, "--sh-degree", a.sh_degree, 0, 3,
               "highest degree of the SH coefficients, 0 to 3; 0: no view-dependent colour [3]");

    start_group(app, "File");
    const auto frames = CLI::IsMember({"rdf", "rub", "luf"});
    app.add_option("--frame", a.frame,
                   "axes of the file: rdf (right, down, forward), rub (right, up, back) or luf "
                   "(left, up, forward) [ply, sog: rdf; spz: rub; glb: luf]")
        ->check(frames);
    app.add_option("--input-frame", a.input_frame, "axes of the input file [as above]")
        ->check(frames);
    app.add_flag(
        "--keep-axes", a.keep_axes,
        "GLB: keep the orientation of the scene [turned upright by the cameras of the run]");
    app.add_option("--spz-version", a.spz_version,
                   "version of SPZ: 2 for old readers, 4 for new ones such as PlayCanvas [3]")
        ->check(CLI::IsMember({2, 3, 4}));
    app.add_option("--spz-sh-bits", a.sh_bits,
                   "SPZ: bits of SH coefficients of degree 1 and above, 1 to 8 each; 5,4 as other "
                   "writers: smaller, with visible loss [8,8]");
    add_number(app, "--sh-palette", a.palette, 1, 65536,
               "SOG: most entries of the SH palette, up to 65536 [by the number of splats]");

    start_group(app, "Check");
    app.add_flag("--no-check", a.no_check, "do not read the file back and compare it");
    app.add_flag("--json", a.json, "print the result as JSON");
    add_output_flag(app, "--out-report", a.report, "file for the same JSON");
    flags.add_scene("Scene (default: that of the run)");
    parse_command_line(app, argc, argv);
    flags.set_keys(table);  // checks the flags before looking for any file

    std::error_code failure;
    if (!fs::exists(a.input, failure))
        throw input_error(a.input, ": not found; expected a run folder or a file of splats");
    if (is_run(a.input) && !a.input_frame.empty())
        throw usage_error("--input-frame ", a.input_frame, ": ", a.input,
                          " is a run folder, whose axes are known; remove the flag");
    if (is_run(a.input)) table.read_file(run_config_path(a.input));
    flags.set_all(table);
    if (!is_run(a.input) && splat_format(a.input) == SplatFormat::ply)
        choose_backbone(a.input, options.train.render, table);
    options.scene.need_points = false;
    options.scene.min_train_views = 1;
    if (fs::equivalent(find_splats(a.input), a.output, failure))
        throw usage_error(a.output, ": this is the input file; choose another name");
    require_output(a.output, {".ply", ".spz", ".sog", ".glb"}, options.scene);
    if (lower_case(a.output).ends_with(".compressed.ply"))
        throw usage_error(a.output,
                          ": compressed PLY is not written; use .sog or .spz, which are "
                          "smaller, or another name for an ordinary PLY");
    if (fs::is_directory(a.output, failure) || !splat_format(a.output))
        throw usage_error(a.output, ": is a folder; expected a file name");
    for (const auto& [flag, format, ending] :
         {std::tuple("--spz-version", SplatFormat::spz, ".spz"),
          {"--spz-sh-bits", SplatFormat::spz, ".spz"},
          {"--sh-palette", SplatFormat::sog, ".sog"}})
        if (app.count(flag) > 0 && a.format() != format)
            throw usage_error(flag, ": only for ", ending, ", not for ", a.output, "; remove it");
    check_report(a);
    return a;
}

SplatFileOptions file_options(const Arguments& a, const RunOptions& options) {
    SplatFileOptions out;
    out.frame = frame_of(a.frame);
    out.spz_version = a.spz_version, out.sog_palette = a.palette;
    const std::vector<double> bits = parse_numbers("--spz-sh-bits", a.sh_bits);
    const auto good = [](double b) { return b >= 1 && b <= 8 && b == std::floor(b); };
    if (bits.size() != 2 || !good(bits[0]) || !good(bits[1]))
        throw usage_error("--spz-sh-bits ", a.sh_bits,
                          ": expected two numbers from 1 to 8, such as 5,4");
    out.spz_sh_bits_1 = static_cast<int>(bits[0]), out.spz_sh_bits_rest = static_cast<int>(bits[1]);
    out.antialiased =
        make_backbone<Cpu>(options.train.backbone, options.train.render)->traits.fades_thin_splats;
    return out;
}

/// The splats of a file, and the position of their frame in the scene's.
struct Input : Georeference {
    std::string path{};
    Gaussians<Cpu> splats{};
};

Input read_input(const Arguments& a, const RunOptions& options, const Scene* scene) {
    Input in;
    in.path = find_splats(a.input);
    const std::optional<SplatFrame> frame = frame_of(a.input_frame);
    if (is_run(a.input)) in.projection = projection_of(a.input);
    if (is_run(a.input) && scene) {
        in.origin = scene->origin;
        in.splats = read_splats(in.path, in.origin, options.train);
        return in;
    }
    in.splats = read_splat_file(in.path, frame);
    if (in.splats.size() == 0)
        throw input_error(in.path, ": no usable splats; expected at least one");
    if (splat_format(in.path) != SplatFormat::ply) {
        static_cast<Georeference&>(in) = read_splat_place(in.path);
        if (scene) {
            const Vec3f off = vec_cast<float>(in.origin - scene->origin);
            for (Vec3f& p : in.splats.means.span()) p += off;
            in.origin = scene->origin;
        }
        return in;
    }
    if (scene) {
        in.origin = scene->origin;
    } else {
        std::vector<Vec3d> places;
        for (const Vec3f p : in.splats.means.span()) places.push_back(vec_cast<double>(p));
        in.origin = local_origin(places);
    }
    if (norm(in.origin) > 0) in.splats = read_splat_file(in.path, frame, in.origin);
    return in;
}

struct ExportReport {
    std::string path;
    SplatFrame frame = SplatFrame::rdf;
    int splats = 0, sh_degree = 0;
    std::uintmax_t bytes = 0;
    SelectionReport left_out;
    // Results of the check, if there was one:
    std::optional<SplatErrors> errors;
    double typical_size = 0;  // result of typical_size()
    int views = 0;            // number of rendered views
    std::string view_kind;    // test or training
    double of_input = 0;      // PSNR of all splats
    RenderScores scores;      // of the exported splats, before and after
};

/// PSNR as text, or "no difference".
std::string decibels(double psnr) {
    return std::isfinite(psnr) ? fmt::format("{:.2f} dB", psnr) : "no difference";
}

/// The median of the splats' second standard deviations, to compare errors of positions with.
double typical_size(const Gaussians<Cpu>& g) {
    std::vector<float> middle;
    for (const Vec3f s : g.log_scales.span())
        middle.push_back(std::max(std::min(s.x, s.y), std::min(std::max(s.x, s.y), s.z)));
    return std::exp(double{middle_of(middle)});
}

/// Logs how many splats were left out, and why.
void log_left_out(const SelectionReport& report, int of, std::size_t views) {
    const auto say_one = [&](std::int64_t count, const std::string& why) {
        if (count > 0)
            spdlog::info("Removed {} of {} splats: {}", grouped(count), grouped(of), why);
    };
    say_one(report.outside, "outside --bbox");
    say_one(report.invisible, "opacity below 1/510, which 8 bits store as 0");
    say_one(report.unseen, fmt::format("invisible in all {} views", views));
    say_one(report.beyond_most, views > 0 ? "more than --max-splats, the least visible ones"
                                          : "more than --max-splats, the smallest ones");
}

void say(const ExportReport& r) {
    spdlog::info("Wrote {}: {} splats, SH degree {}, {} bytes ({:.1f} each); axes: {}", r.path,
                 grouped(r.splats), r.sh_degree, grouped(r.bytes),
                 static_cast<double>(r.bytes) / r.splats, info_of(r.frame).axes);
    if (!r.errors) return;
    const SplatErrors& e = *r.errors;
    spdlog::info(
        "Largest rounding errors: position {:.3g}, size {:.2g} %, rotation {:.2g} degrees, opacity "
        "{:.2g}, SH coefficients {:.2g} (degree 0), {:.2g} (1), {:.2g} (2 and 3)",
        e.mean, 100 * (std::exp(e.log_scale) - 1), e.degrees, e.opacity, e.color, e.sh_1,
        e.sh_rest);
    if (e.median_mean > 0.1 * r.typical_size)
        spdlog::warn(
            "{}: position error {:.3g}, splats are {:.3g} wide: far splats use up the digits; "
            "remove them with --bbox, or write a .ply or .glb",
            r.path, e.median_mean, r.typical_size);
    if (r.views == 0) return;
    if (r.of_input != r.scores.before)
        spdlog::info(
            "PSNR of {} {} views: {} with all splats, {} with the kept ones, {} after rounding; "
            "renders before and after rounding: {}",
            r.views, r.view_kind, decibels(r.of_input), decibels(r.scores.before),
            decibels(r.scores.after), decibels(r.scores.between));
    else
        spdlog::info(
            "PSNR of {} {} views: {} before rounding, {} after; renders before and after: {}",
            r.views, r.view_kind, decibels(r.scores.before), decibels(r.scores.after),
            decibels(r.scores.between));
}

/// One line, with its end.
std::string report_json(const ExportReport& r) {
    JsonValue out, left_out, errors, views;
    left_out.add("outside", r.left_out.outside)
        .add("invisible", r.left_out.invisible)
        .add("unseen", r.left_out.unseen)
        .add("beyond_most", r.left_out.beyond_most);
    out.add("version", kVersion)
        .add("file", r.path)
        .add("format", lower_case(fs::path(r.path).extension().string()).substr(1))
        .add("frame", info_of(r.frame).name)
        .add("splats", r.splats)
        .add("sh_degree", r.sh_degree)
        .add("bytes", r.bytes)
        .add("left_out", left_out);
    if (r.errors) {
        errors.add("position", r.errors->mean)
            .add("position_median", r.errors->median_mean)
            .add("log_scale", r.errors->log_scale)
            .add("rotation_degrees", r.errors->degrees)
            .add("opacity", r.errors->opacity)
            .add("sh_0", r.errors->color)
            .add("sh_1", r.errors->sh_1)
            .add("sh_rest", r.errors->sh_rest);
        out.add("errors", errors);
    }
    if (r.views > 0) {
        views.add("kind", r.view_kind)
            .add("count", r.views)
            .add("psnr_input", r.of_input)
            .add("psnr_before", r.scores.before)
            .add("psnr_after", r.scores.after)
            .add("psnr_between", r.scores.between);
        out.add("views", views);
    }
    return json_text(out) + "\n";
}

}  // namespace

int command(int argc, char** argv) {
    Configuration configuration;
    const Arguments a = parse(argc, argv, configuration);
    RunOptions& options = configuration.options;
    // 1. Read the splats, and the views that have seen them.
    SplatFileOptions how = file_options(a, options);
    const DeviceChoice device = choose_device(a.device);
    std::optional<Scene> scene;
    if (!options.scene.path.empty() && a.needs_views())
        scene = with_context("reading its views (not needed with --no-check and --keep-axes)",
                             [&] { return read_scene_of_run(options.scene, a.input); });
    if (a.prune_unseen && !scene)
        throw usage_error("--prune-unseen: ", a.input, " is not a run folder; give --scene DIR");
    Input in = read_input(a, options, scene ? &*scene : nullptr);
    if (scene && !a.no_check) read_sky(options.train.loss.photometric, a.input);
    how.origin = in.origin, how.projection = in.projection;
    if (!in.projection.empty() && !a.keep_axes) how.upright_from_scene = kUprightFromProjection;
    std::vector<Camera> cameras;
    if (scene) {
        for (const std::vector<View>* views : {&scene->train, &scene->test})
            for (const View& view : *views) cameras.push_back(view.camera);
        if (!a.keep_axes && in.projection.empty())
            how.upright_from_scene = upright_from_scene(upright_cameras(scene->train));
    }

    // 2. Select splats.
    SplatSelection selection;
    if (!a.box.empty()) {
        selection.box = parse_box("--bbox", a.box);
        selection.box->low -= in.origin, selection.box->high -= in.origin;
    }
    selection.drop_invisible = a.format() != SplatFormat::ply;
    selection.drop_unseen = a.prune_unseen;
    selection.max_splats = a.max_splats;
    selection.sort = a.format() == SplatFormat::spz || a.format() == SplatFormat::sog;
    selection.sh_degree = a.sh_degree;
    std::vector<double> light;
    if (scene && (a.prune_unseen || (a.max_splats > 0 && in.splats.size() > a.max_splats)))
        light = on_device(device, [&](auto tag) {
            return blend_weight_of_splats<decltype(tag)>(in.splats, cameras, options.train);
        });
    ExportReport report;
    report.path = a.output, report.frame = how.frame.value_or(default_frame(a.format()));
    Gaussians<Cpu> kept;
    copy(in.splats, kept);
    report.left_out = select_splats(selection, light, kept);
    report.splats = kept.size(), report.sh_degree = kept.sh_degree;
    if (report.splats == 0)
        throw input_error(in.path, ": none of its ", grouped(in.splats.size()),
                          " splats is left; loosen --bbox or --prune-unseen");
    log_left_out(report.left_out, in.splats.size(), cameras.size());

    // 3. Write the file, and check it.
    report.bytes = write_splat_file(a.output, kept, how);
    if (!a.no_check) {
        const Gaussians<Cpu> written = read_splat_file(a.output, how.frame, in.origin);
        report.errors = errors_of(kept, written);
        report.typical_size = typical_size(kept);
        if (scene) {
            const bool test = !scene->test.empty();
            const std::vector<View>& views = test ? scene->test : scene->train;
            report.views = static_cast<int>(views.size());
            report.view_kind = test ? "test" : "training";
            on_device(device, [&](auto tag) {
                using Device = decltype(tag);
                report.scores = compare_renders<Device>(kept, written, views, options.train);
                report.of_input = report.scores.before;
                // Invisible splats do not affect any render.
                if (kept.size() + report.left_out.invisible != in.splats.size() ||
                    kept.sh_degree != in.splats.sh_degree)
                    report.of_input =
                        compare_renders<Device>(in.splats, kept, views, options.train).before;
            });
        }
    }
    say(report);
    const std::string json = report_json(report);
    if (a.json) std::fputs(json.c_str(), stdout);
    if (!a.report.empty()) write_text_file(a.report, json), spdlog::info("Report: {}", a.report);
    if (is_run(a.input))
        say_next({"tvsgs-view", a.input}, "look at the run in a browser");
    else if (!a.output.ends_with(".ply"))
        say_next({"tvsgs-export", a.output, "splats.ply"}, "turn it back into a PLY");
    return 0;
}

}  // namespace tvsgs
