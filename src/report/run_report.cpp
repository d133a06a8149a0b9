#include "report/run_report.h"

#include <filesystem>

#include "pipeline/run/run_folder.h"
#include "pipeline/run/run_options.h"
#include "report/data.h"

namespace tvsgs {
namespace fs = std::filesystem;

void make_report(const std::string& run, const std::string& scene_path) {
    RunOptions options;
    OptionTable table;
    options.add_to(table);
    table.read_file(run_config_path(run));
    if (!scene_path.empty()) options.scene.path = scene_path;
    options.scene.need_points = false;
    Scene scene;
    std::vector<std::string> missing;
    if_possible(
        "photographs", [&] { scene = read_scene_of_run(options.scene, run); }, "report", &missing);
    write_report(run, scene, std::move(missing));
    spdlog::info("Report: {}/report.html", run);
}

std::string refresh_report(const std::string& written) {
    const fs::path folder = fs::path(written).parent_path();
    const std::string run = folder.has_parent_path() ? folder.parent_path().string() : ".";
    std::error_code code;
    const bool is_mesh = folder.filename() == "mesh" && fs::path(written).stem() == "mesh",
               is_score = folder.filename() == "eval" && fs::path(written).extension() == ".json" &&
                          fs::is_regular_file(fs::path(run) / "report.json", code);
    if (!(is_mesh || is_score) || !fs::is_regular_file(fs::path(run) / "config.json", code))
        return {};
    try {
        make_report(run);
        return run;
    } catch (const Error& error) {
        spdlog::warn("{}; the report was not updated; try tvsgs-eval report --run {}", error.what(),
                     run);
        return {};
    }
}

}  // namespace tvsgs
