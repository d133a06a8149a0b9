#include "apps/export/report.h"

#include <algorithm>
#include <vector>

#include "core/grouped.h"
#include "core/log.h"
#include "core/version.h"
#include "io/files/json_value.h"

namespace tvsgs {
namespace {

const char* format_name(SplatFormat format) {
    return format == SplatFormat::ply   ? "ply"
           : format == SplatFormat::spz ? "spz"
           : format == SplatFormat::sog ? "sog"
                                        : "glb";
}

const char* axes(SplatFrame frame) {
    return frame == SplatFrame::rdf   ? "x right, y down, z forward"
           : frame == SplatFrame::rub ? "x right, y up, z back"
                                      : "x left, y up, z forward";
}

/// PSNR as text, or "no difference".
std::string decibels(double psnr) {
    return std::isfinite(psnr) ? fmt::format("{:.2f} dB", psnr) : "no difference";
}

}  // namespace

double typical_size(const Gaussians<Cpu>& g) {
    std::vector<float> middle;
    for (const Vec3f s : g.log_scales.span())
        middle.push_back(std::max(std::min(s.x, s.y), std::min(std::max(s.x, s.y), s.z)));
    const auto at = middle.begin() + static_cast<std::ptrdiff_t>(middle.size() / 2);
    std::nth_element(middle.begin(), at, middle.end());
    return std::exp(double{*at});
}

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
                 static_cast<double>(r.bytes) / r.splats, axes(r.frame));
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

std::string report_json(const ExportReport& r) {
    JsonValue out, left_out, errors, views;
    left_out.add("outside", r.left_out.outside)
        .add("invisible", r.left_out.invisible)
        .add("unseen", r.left_out.unseen)
        .add("beyond_most", r.left_out.beyond_most);
    out.add("version", kVersion)
        .add("file", r.path)
        .add("format", format_name(r.format))
        .add("frame", frame_name(r.frame))
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

}  // namespace tvsgs
