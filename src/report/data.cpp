#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>

#include "core/device/threads.h"
#include "core/math/quantile.h"
#include "eval/points.h"
#include "io/files/atomic_file.h"
#include "io/files/read_file.h"
#include "io/images/image_file.h"
#include "pipeline/run/run_folder.h"
#include "pipeline/run/run_options.h"
#include "report/page_data.h"
#include "report/report.h"
#include "report/view_page.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxRows = 600;           // rows of the log, evenly thinned
constexpr std::size_t kMaxViews = 8;            // views with pictures
constexpr int kPictureWidth = 400;              // px; two pictures fit side by side on a desktop
constexpr std::uintmax_t kMaxResult = 4 << 20;  // bytes of a file in RUN/eval
constexpr std::size_t kViewBytes = 12'000'000;  // of the 3D view, so that the page opens at once
constexpr std::size_t kViewFacesHere = 100'000;

JsonValue read_json(const std::string& path) {
    return parse_json_value(read_bytes(path), path);
}

/// Sides of the box of the points.
JsonValue size_of(const std::vector<Vec3f>& points) {
    Points places;
    for (const Vec3f p : points) places.push_back(vec_cast<double>(p));
    const PointBounds box = bounds_of(places);
    const Vec3d size = box.upper - box.lower;
    return std::vector{size.x, size.y, size.z};
}

/// Median width of a pixel, world units, at the splats that training views see; 0: they see none.
double pixel_at(const Gaussians<Cpu>& splats, const std::vector<ViewCamera>& cameras) {
    constexpr int kSample = 1000;  // splats
    std::vector<double> sizes;
    for (const ViewCamera& view : cameras)
        for (int i = 0; !view.test && i < splats.size(); i += 1 + splats.size() / kSample)
            if (const Vec3f mean = splats.means[i]; is_in_view(view.camera, mean))
                sizes.push_back(
                    double((view.camera.camera_from_world * mean).z / view.camera.fx_px));
    return quantile(sizes, 0.5);
}

/// One list per column: shorter than an object per line, and ready for plots.
JsonValue columns(const std::vector<const JsonValue*>& reports) {
    JsonValue table;
    const auto column = [&](auto&& value_of) {
        JsonValue list = JsonValue::list();
        for (const JsonValue* line : reports) list.items.push_back(value_of(*line));
        return list;
    };
    for (const char* key : {"iteration", "seconds", "loss", "gaussians", "bytes", "peak_bytes"})
        table.add(key, column([&](const JsonValue& line) { return line[key]; }));
    JsonValue terms = JsonValue::object();
    for (const auto& [name, value] : (*reports.back())["terms"].members)
        terms.set(name, column([&](const JsonValue& line) { return line["terms"][name]; }));
    return table.add("terms", std::move(terms));
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
    std::ranges::sort(files);
    for (const fs::path& file : files) {
        const std::string name = file.stem().string();
        if (fs::file_size(file, code) > kMaxResult) continue;
        JsonValue result;
        try {
            result = read_json(file.string());
        } catch (const Error& error) {  // a file of another program: leave it out
            spdlog::warn("{}; not in the report", error.what());
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

/// Turns the directions of a picture of normals (red right, green up; black: none) clockwise.
void turn_normal_colors(ImageU8& image, int quarters) {
    for (int i = 0; i < image.width * image.height; ++i) {
        std::uint8_t* const rgb = &image.pixels[3 * static_cast<std::size_t>(i)];
        if (rgb[0] + rgb[1] + rgb[2] == 0) continue;
        for (int k = 0; k < quarters; ++k) {
            const std::uint8_t right = rgb[1];
            rgb[1] = static_cast<std::uint8_t>(255 - rgb[0]), rgb[0] = right;
        }
    }
}

/// Renders beside their photographs, both upright, ordered from the worst PSNR to the best.
JsonValue pictures(const std::string& run,
                   const JsonValue& views,
                   const std::vector<View>& photographs) {
    std::vector<const JsonValue*> order;
    for (const JsonValue& view : views.items)
        if (is_file(render_stem(run, view["name"].text) + ".png")) order.push_back(&view);
    std::ranges::stable_sort(order, [](const JsonValue* a, const JsonValue* b) {
        return (*a)["psnr"].number_or(INFINITY) < (*b)["psnr"].number_or(INFINITY);
    });
    JsonValue list = JsonValue::list();
    const std::size_t n = order.size(), count = std::min(n, kMaxViews);
    list.items.resize(count);
    run_chunks(static_cast<int>(count), [&](int chunk, int /*slot*/) {
        const auto i = static_cast<std::size_t>(chunk);
        const JsonValue& view = *order[count < 2 ? 0 : i * (n - 1) / (count - 1)];
        const std::string name = view["name"].text, stem = render_stem(run, name);
        const ImageU8 render = read_image(stem + ".png", 3);
        JsonValue entry;
        entry.add("name", name).add("psnr", view["psnr"]).add("ssim", view["ssim"]);
        const auto found = std::ranges::find(photographs, name, &View::name);
        const bool known = found != photographs.end();
        const int turns = known ? found->upright_turns : 0;
        const auto set = [&](const char* kind, const ImageU8& image) {
            entry.set(kind, picture_json(turned_clockwise(image, turns), kPictureWidth));
        };
        if (known && found->photo.width == render.width && found->photo.height == render.height) {
            set("photo", found->photo);
            set("difference", difference_image(render, found->photo));
        }
        set("render", render);
        for (const char* kind : {"normal", "depth"}) {
            const std::string path = str(stem, "_", kind, ".png");
            if (!is_file(path)) continue;
            ImageU8 image = read_image(path, 3);
            if (kind[0] == 'n') turn_normal_colors(image, turns);
            set(kind, image);
        }
        list.items[i] = std::move(entry);
    });
    return list;
}

/// Builds report.json and the page's 3D view.
class Collector {
public:
    Collector(const std::string& run, const Scene& scene, std::vector<std::string> missing)
        : run_(run), scene_(scene), missing_(std::move(missing)) {}

    JsonValue collect() {
        add_config();
        add_decisions();
        part("curves", [&] {
            const auto lost = [&](const std::string& why) { missing_.push_back(why); };
            const std::string log = run_ + "/log.jsonl";
            add_log(report_, parse_json_lines(read_bytes(log), log, lost));
        });
        part("scores", [&] { add_results(report_, run_); });
        part("pictures",
             [&] { report_.set("pictures", pictures(run_, report_["views"], scene_.test)); });
        part("the view in 3D", [&] { add_view(); });
        if (!missing_.empty()) report_.set("missing", missing_);
        return std::move(report_);
    }

    const std::optional<ViewPage>& view() const { return view_; }

private:
    template <class Action>
    void part(const char* name, const Action& action) {
        if_possible(name, action, "report", &missing_);
    }

    void add_config() {
        JsonValue config = read_json(run_config_path(run_));
        report_.set("format", "tvsgs-report");
        report_.set("format_version", 2);
        JsonValue about = config["info"];
        about.set("name", folder_name(run_));
        about.set("scene", folder_name(config["scene"]["path"].text));
        report_.set("run", std::move(about));
        std::erase_if(config.members, [](const auto& member) { return member.first == "info"; });
        report_.set("config", std::move(config));
    }

    /// A run with fixed settings has no plan.
    void add_decisions() {
        const std::string plan = run_ + "/plan.json", memory = run_ + "/memory.json";
        part("the plan", [&] {
            if (!is_file(plan)) return;
            const JsonValue decisions = read_json(plan)["decisions"];
            if (!decisions.is(JsonValue::Kind::list))
                throw input_error(plan, ": no decisions; expected the file of tvsgs-train");
            report_.set("plan", decisions);
        });
        part("the memory limits", [&] { report_.set("memory", read_json(memory)); });
    }

    void add_view() {
        ViewInput input;
        input.runs = {run_}, input.loaded = &scene_, input.may_train = true;
        input.max_faces = kViewFacesHere, input.whole = "report";
        ViewSubject subject = read_view_subject(input);
        missing_.insert(missing_.end(), subject.missing.begin(), subject.missing.end());
        for (const JsonValue& view : report_["views"].items)
            for (ViewCamera& camera : subject.cameras)
                camera.test = camera.test || camera.name == view["name"].text;
        const auto training =
            std::ranges::count_if(subject.cameras, [](const ViewCamera& c) { return !c.test; });
        report_.set("training_views", training);
        ViewRun& run = subject.runs.front();
        if (run.mesh_faces > 0)
            report_.set("mesh", JsonValue()
                                    .add("faces", run.mesh_faces)
                                    .add("size", size_of(run.mesh.vertices))
                                    .add("unit", subject.metres ? "metres" : "units"));
        if (const std::string file = scene_.path + "/prepare.json"; is_file(file))
            report_.set("placement", read_json(file)["georeference"]);
        report_.set("pixel", pixel_at(run.splats, subject.cameras));
        if (static_cast<std::size_t>(training) > kMaxCoverageViews)
            missing_.push_back(str("coverage: measured for at most ", kMaxCoverageViews,
                                   " training views, this run has ", training));
        if (run.splats.size() == 0)
            throw input_error(run_, ": no splats yet; wait for the end of the training");
        report_.set("splats", run.splats.size());
        report_.set("coverage", coverage_json(run.splats, subject.cameras));
        if (!report_["coverage"] && static_cast<std::size_t>(training) <= kMaxCoverageViews)
            missing_.push_back("coverage: no training view sees a splat");
        // The report has its own plots.
        run.evaluations = {};
        view_ = view_page(std::move(subject), {.max_bytes = kViewBytes});
    }

    const std::string& run_;
    const Scene& scene_;
    std::vector<std::string> missing_;
    JsonValue report_ = JsonValue::object();
    std::optional<ViewPage> view_;
};

}  // namespace

std::string folder_name(const std::string& path) {
    std::error_code code;
    fs::path clean = fs::absolute(path, code).lexically_normal();
    if (clean.filename().empty()) clean = clean.parent_path();
    return clean.filename().string();
}

void write_report(const std::string& run, const Scene& scene, std::vector<std::string> missing) {
    Collector collector(run, scene, std::move(missing));
    const std::string json = json_text(collector.collect());
    write_text_file(run + "/report.json", json + "\n");
    // Reads the written file: except for the 3D view, the page depends on report.json only.
    write_text_file(run + "/report.html",
                    report_html(parse_json_value(json, run + "/report.json"), collector.view()));
}

void make_report(const std::string& run, const std::string& scene_path) {
    Configuration configuration;
    auto& [options, table] = configuration;
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
