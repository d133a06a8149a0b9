#include "apps/reconstruct/summary.h"

#include <algorithm>
#include <filesystem>
#include <limits>

#include "apps/common/command_line.h"
#include "core/grouped.h"
#include "io/files/json_value.h"
#include "io/files/read_file.h"
#include "io/mesh/mesh_files.h"
#include "pipeline/run/run_folder.h"
#include "report/verdict.h"
#include "report/view_run.h"

namespace tvsgs::reconstruct {
namespace {

namespace fs = std::filesystem;

JsonValue json_of(const fs::path& file) {
    std::error_code code;
    return fs::is_regular_file(file, code) ? parse_json_value(read_bytes(file), file) : JsonValue();
}

std::string count_of(const JsonValue& value, const std::string& what) {
    return counted(static_cast<std::size_t>(std::max(0.0, value.number_or(0))), what);
}

/// "1.92 x 2.01 x 1.8": the box of the mesh.
std::string size_text(const std::string& mesh) {
    constexpr double kFar = std::numeric_limits<double>::max();
    Vec3d low{kFar, kFar, kFar}, high = -low;
    for (const Vec3d p : read_mesh_geometry(mesh).positions)
        for (int c = 0; c < 3; ++c)
            low[c] = std::min(low[c], p[c]), high[c] = std::max(high[c], p[c]);
    return fmt::format("{:.3g} x {:.3g} x {:.3g}", high.x - low.x, high.y - low.y, high.z - low.z);
}

}  // namespace

void log_summary(const std::string& run, const std::string& scene, const std::string& page) {
    const JsonValue report = json_of(run + "/report.json"),
                    prepared = json_of(scene + "/prepare.json");
    const RunVerdict verdict = verdict_of(report);
    const std::string mesh = find_mesh(run);
    std::string given;
    if (const double all = prepared["photographs"].number; all > report["training_views"].number)
        given = str(" of ", all);
    spdlog::info("Reconstructed {}{}: {}, mesh of {}, {} {}",
                 count_of(report["training_views"], "photograph"), given,
                 count_of(report["splats"], "splat"), count_of(report["mesh"]["faces"], "face"),
                 size_text(mesh), in_metres(run, scene) ? "metres" : "units of the scene");
    if (!verdict.level.empty()) spdlog::info("Quality: {}", verdict.level);
    for (const std::string& limit : verdict.limits) spdlog::info("Limit: {}", limit);
    if (!verdict.limits.empty())
        for (const std::string& next : verdict.next) spdlog::info("Photograph next: {}", next);
    spdlog::info("Mesh: {}\nPage: {}\nReport: {}/report.html", mesh, page, run);
    say_next({"tvsgs-export", run, "splats.spz"}, "write the splats for other viewers");
}

}  // namespace tvsgs::reconstruct
