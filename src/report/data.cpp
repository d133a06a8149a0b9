#include "report/data.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numeric>

#include "core/log.h"
#include "io/atomic_file.h"
#include "io/mesh_files.h"
#include "io/ply.h"
#include "io/read_file.h"
#include "pipeline/run_folder.h"
#include "report/html.h"
#include "report/pictures.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxRows = 600;           // of the log, evenly thinned
constexpr std::size_t kMaxViews = 8;            // with pictures
constexpr int kPictureWidth = 400;              // px; two fit beside each other on a desk
constexpr std::uintmax_t kMaxResult = 4 << 20;  // bytes of a file of RUN/eval

bool exists(const std::string& path) {
    std::error_code code;
    return fs::is_regular_file(path, code);
}

JsonValue read_json(const std::string& path) {
    return parse_json_value(read_bytes(path), path);
}

/// The lines of log.jsonl; a last one that a killed run left unfinished does not count.
std::vector<JsonValue> read_log(const std::string& path) {
    std::vector<JsonValue> lines;
    if (!exists(path)) return lines;
    const std::string text = read_bytes(path);
    for (std::size_t at = 0; at < text.size();) {
        const std::size_t end = text.find('\n', at);
        if (end == std::string::npos) break;
        lines.push_back(parse_json_value(std::string_view(text).substr(at, end - at),
                                         str(path, ": line ", lines.size() + 1)));
        at = end + 1;
    }
    return lines;
}

/// One list per column: shorter than one object per line, and what plots need.
JsonValue columns(const std::vector<const JsonValue*>& reports) {
    JsonValue table = JsonValue::object();
    const auto column = [&](auto&& value_of) {
        JsonValue list = JsonValue::list();
        for (const JsonValue* line : reports) list.items.push_back(value_of(*line));
        return list;
    };
    for (const char* key : {"iteration", "seconds", "loss", "gaussians", "bytes", "peak_bytes"})
        table.set(key, column([&](const JsonValue& line) { return line[key]; }));
    JsonValue terms = JsonValue::object();
    for (const auto& [name, value] : (*reports.back())["terms"].members)
        terms.set(name, column([&](const JsonValue& line) { return line["terms"][name]; }));
    table.set("terms", std::move(terms));
    return table;
}

void add_log(JsonValue& report, const std::vector<JsonValue>& lines) {
    std::vector<const JsonValue*> reports;
    JsonValue evaluations = JsonValue::list(), summary = JsonValue::object();
    bool finished = false;
    for (const JsonValue& line : lines) {
        const std::string event = line["event"].text;
        if (event.empty()) reports.push_back(&line);
        if (event == "done") finished = true, summary = line;
        const bool measured = line["psnr"] || line["centres"];
        if (measured && (event == "evaluation" || event == "done"))
            evaluations.items.push_back(line);
    }
    if (!finished && !reports.empty())
        for (const char* key : {"iteration", "seconds", "gaussians", "peak_bytes"})
            summary.set(key, (*reports.back())[key]);
    summary.set("event", finished ? "done" : "unfinished");
    report.set("summary", std::move(summary));
    if (!reports.empty()) {
        report.set("stages", (*reports.back())["stage_seconds"]);
        std::vector<const JsonValue*> kept;
        const std::size_t n = reports.size(), rows = std::min(n, kMaxRows);
        for (std::size_t i = 0; i < rows; ++i)
            kept.push_back(reports[rows < 2 ? 0 : i * (n - 1) / (rows - 1)]);
        report.set("reports", columns(kept));
    }
    report.set("evaluations", std::move(evaluations));
}

void add_results(JsonValue& report, const std::string& run) {
    JsonValue results = JsonValue::object();
    std::vector<fs::path> files;
    std::error_code code;
    for (fs::directory_iterator it(run + "/eval", code), end; !code && it != end;
         it.increment(code))
        if (it->path().extension() == ".json") files.push_back(it->path());
    std::sort(files.begin(), files.end());
    for (const fs::path& file : files) {
        const std::string name = file.stem().string();
        if (fs::file_size(file, code) > kMaxResult) continue;
        JsonValue result;
        try {
            result = read_json(file.string());
        } catch (const Error& error) {  // somebody else's: the report does without
            spdlog::warn("{}; the report leaves it out", error.what());
            continue;
        }
        if (name == "nvs") {
            JsonValue views = JsonValue::list();
            for (const auto& [view, scores] : result["per_view"].members) {
                JsonValue row = scores;
                row.set("name", view);
                views.items.push_back(std::move(row));
            }
            report.set("views", std::move(views));
            std::erase_if(result.members, [](const auto& m) { return m.first == "per_view"; });
            report.set("nvs", std::move(result));
        } else if (name == "centres") {
            report.set("curve", result["curve"]);
        } else if (name == "mesh" && result["curve"]) {
            report.set("mesh_curve", result["curve"]);
        } else {
            results.set(name, std::move(result));
        }
    }
    if (!results.members.empty()) report.set("results", std::move(results));
}

/// Renders beside their photographs, from the worst PSNR to the best.
JsonValue pictures(const std::string& run,
                   const JsonValue& views,
                   const std::vector<View>& photographs) {
    std::vector<const JsonValue*> order;
    for (const JsonValue& view : views.items)
        if (exists(render_stem(run, view["name"].text) + ".png")) order.push_back(&view);
    std::stable_sort(order.begin(), order.end(), [](const JsonValue* a, const JsonValue* b) {
        return (*a)["psnr"].number_or(INFINITY) < (*b)["psnr"].number_or(INFINITY);
    });
    JsonValue list = JsonValue::list();
    const std::size_t n = order.size(), count = std::min(n, kMaxViews);
    for (std::size_t i = 0; i < count; ++i) {
        const JsonValue& view = *order[count < 2 ? 0 : i * (n - 1) / (count - 1)];
        const std::string name = view["name"].text, stem = render_stem(run, name);
        const ImageU8 render = read_image(stem + ".png", 3);
        JsonValue entry = JsonValue::object();
        entry.set("name", name);
        entry.set("psnr", view["psnr"]);
        entry.set("ssim", view["ssim"]);
        for (const View& photograph : photographs) {
            const ImageU8& photo = photograph.photo;
            if (photograph.name != name || photo.width != render.width ||
                photo.height != render.height)
                continue;
            entry.set("photo", picture_json(photo, kPictureWidth));
            entry.set("difference", picture_json(difference_image(render, photo), kPictureWidth));
        }
        entry.set("render", picture_json(render, kPictureWidth));
        for (const char* kind : {"normal", "depth"}) {
            const std::string path = str(stem, "_", kind, ".png");
            if (exists(path)) entry.set(kind, picture_json(read_image(path, 3), kPictureWidth));
        }
        list.items.push_back(std::move(entry));
    }
    return list;
}

}  // namespace

JsonValue collect_report(const std::string& run,
                         const std::vector<View>& test,
                         const std::optional<Truth>& truth,
                         Vec3d origin) {
    JsonValue report = JsonValue::object(), config = read_json(run_config_path(run));
    report.set("format", "tvsgs-report");
    report.set("format_version", 1);
    JsonValue about = config["info"];
    const auto name_of = [](const std::string& path) {
        fs::path clean = fs::path(path).lexically_normal();
        if (clean.filename().empty()) clean = clean.parent_path();
        return clean.filename().string();
    };
    std::error_code code;
    about.set("name", name_of(fs::absolute(run, code).string()));
    about.set("scene", name_of(config["scene"]["path"].text));
    report.set("run", std::move(about));
    std::erase_if(config.members, [](const auto& member) { return member.first == "info"; });
    report.set("config", std::move(config));
    if_possible("curves", [&] { add_log(report, read_log(run + "/log.jsonl")); });
    if_possible("scores", [&] { add_results(report, run); });
    if_possible("pictures", [&] { report.set("pictures", pictures(run, report["views"], test)); });
    const std::string cameras = run + "/cameras.json", mesh = find_mesh(run);
    Viewpoint viewpoint = viewpoint_of(JsonValue());
    if_possible("the view of a camera", [&] {
        if (exists(cameras)) viewpoint = viewpoint_of(read_json(cameras));
    });
    if_possible("centres", [&] {
        if (fs::exists(run + "/point_cloud", code))
            report.set("points", points_json(centres_of(read_splat_ply(find_splats(run), origin)),
                                             truth, viewpoint));
    });
    if_possible("a mesh", [&] {
        if (!mesh.empty())
            report.set("mesh_points",
                       points_json(read_mesh(mesh, origin).points, truth, viewpoint));
    });
    return report;
}

void write_report(const std::string& run,
                  const std::vector<View>& test,
                  const std::optional<Truth>& truth,
                  Vec3d origin) {
    const std::string json = json_text(collect_report(run, test, truth, origin));
    write_text_file(run + "/report.json", json + "\n");
    // From what was written: the page is a function of report.json alone.
    write_text_file(run + "/report.html",
                    report_html(parse_json_value(json, run + "/report.json")));
}

}  // namespace tvsgs
