// tvsgs-reconstruct: photographs, a video or a scene in; splats, textured mesh and 3D page out.
// Runs the programs of the stages, and continues where it was stopped.
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <optional>

#include "apps/common/command_line.h"
#include "apps/common/open_page.h"
#include "apps/prepare/photographs.h"
#include "apps/reconstruct/stages.h"
#include "core/device/device_choice.h"
#include "core/device/threads.h"
#include "core/grouped.h"
#include "core/progress.h"
#include "io/files/manifest.h"
#include "io/files/read_file.h"
#include "io/scene/scene_layout.h"
#include "io/scene/scene_reader.h"
#include "pipeline/run/run_folder.h"
#include "pipeline/run/signals.h"
#include "report/report.h"

namespace tvsgs {
namespace {

using namespace reconstruct;
namespace fs = std::filesystem;
using Words = std::vector<std::string>;  // a command line

struct Arguments {
    std::string photos, out, quality = "normal", device = "auto";
    std::optional<int> resolution;
    double time_budget = 0;
    bool overwrite = false, open = false;
    Words of_prepare;  // flags for tvsgs-prepare
    Words of_machine;  // flags for all programs that change no result
};

std::string absolute(const std::string& path) {
    const fs::path whole = fs::absolute(path).lexically_normal();
    return (whole.has_filename() ? whole : whole.parent_path()).string();
}

Arguments parse(int argc, char** argv) {
    Arguments a;
    CLI::App app{
        "Photographs in; splats, textured mesh and 3D page out. Runs tvsgs-prepare, tvsgs-train, "
        "tvsgs-extract-mesh and tvsgs-view. The same command continues a stopped reconstruction.",
        "tvsgs-reconstruct"};
    app.get_formatter()->column_width(40);
    app.add_option("photos", a.photos,
                   "folder of photographs, a video, or a scene that has cameras")
        ->required();
    app.add_option("out", a.out,
                   "folder to write: scene/ (if cameras are searched), run/, view.html")
        ->required();
    add_choice(app, "--quality", a.quality, {"draft", "normal", "best"},
               "width of the photographs in pixels, draft: 800, normal: 1,600, best: 3,200; at "
               "most that of the narrowest photograph. draft also trains 800 iterations only");
    app.add_option("-r,--resolution", a.resolution,
                   "size of the photographs in the training: 1, 2, 4, 8: divide it; other: width "
                   "in pixels [by --quality]");
    add_number(app, "--time-budget", a.time_budget, 0, 1e9,
               "shorten the training to so many seconds [0: no limit]");
    std::string gcp, checkpoints;
    bool gps = false;
    app.add_option("--gcp", gcp,
                   "list of control points: puts the scene into metres at its place (as "
                   "tvsgs-prepare does)");
    app.add_option("--checkpoints", checkpoints,
                   "names of control points, with commas: only measured");
    app.add_flag("--gps", gps, "put the scene into metres by the places of the cameras in EXIF");
    app.add_option("--device", a.device, "auto, cpu, cuda or cuda:N");
    app.add_flag("--overwrite", a.overwrite,
                 "start anew: remove the files that an earlier call wrote to OUT");
    app.add_flag("--open", a.open, "open the page in the browser of the desktop (xdg-open)");
    add_log_flags(app);
    parse_command_line(app, argc, argv);
    if (a.device != "auto" && (!kHasCuda || !a.device.starts_with("cuda"))) choose_device(a.device);
    resized_size(a.resolution.value_or(-1), 1, 1);  // reports a wrong value
    while (a.out.size() > 1 && a.out.ends_with('/')) a.out.pop_back();
    if (!gcp.empty()) a.of_prepare = {"--gcp", absolute(gcp)};
    if (!checkpoints.empty())
        a.of_prepare.insert(a.of_prepare.end(), {"--checkpoints", checkpoints});
    if (gps) a.of_prepare.emplace_back("--gps");
    if (app.count("--threads") > 0) a.of_machine = {"--threads", str(thread_count())};
    return a;
}

/// The cameras and image names of a scene; nothing if the folder has no cameras.
std::optional<SceneLayout> layout_of(const std::string& folder) {
    SceneOptions options;
    options.path = folder;
    try {
        return read_layout(options);
    } catch (const Error& error) {
        if (std::string_view(error.what()).starts_with("E_SCENE_LAYOUT")) return std::nullopt;
        throw;
    }
}

/// Whether a training has ended in the run folder, and not by a signal.
bool is_trained(const std::string& run) {
    const std::string log = run + "/log.jsonl";
    if (!fs::is_regular_file(log) || !holds_splats(run)) return false;
    const std::vector<JsonValue> lines =
        parse_json_lines(read_bytes(log), log, [](const std::string&) {});
    return std::ranges::any_of(lines,
                               [](const JsonValue& line) { return line["event"].text == "done"; });
}

/// Whether the run folder has a mesh that its report knows.
bool is_meshed(const std::string& run) {
    const std::string mesh = find_mesh(run), report = run + "/report.json";
    return !mesh.empty() && fs::exists(report) &&
           fs::last_write_time(report) >= fs::last_write_time(mesh);
}

/// Lists all files of a folder, so that remove_listed_files() removes them.
void list_files(const fs::path& folder) {
    std::vector<fs::path> files;
    for (const auto& entry : fs::recursive_directory_iterator(folder))
        if (entry.is_regular_file()) files.push_back(entry.path());
    start_manifest(folder);
    for (const fs::path& file : files) add_to_manifest(folder, file);
}

JsonValue json_of(const fs::path& file) {
    std::error_code code;
    return fs::is_regular_file(file, code) ? parse_json_value(read_bytes(file), file) : JsonValue();
}

std::string count_of(const JsonValue& value, const std::string& what) {
    return counted(std::size_t(std::max(0.0, value.number_or(0))), what);
}

/// Logs the results of a run folder: numbers, limits of the quality, and places of the files.
/// `scene`: of the run; its prepare.json, if there is one, has the number of given photographs.
void log_summary(const std::string& run, const std::string& scene, const std::string& page) {
    const JsonValue report = json_of(run + "/report.json"),
                    prepared = json_of(scene + "/prepare.json");
    const RunVerdict verdict = verdict_of(report);
    const std::string mesh = find_mesh(run);
    const auto sides = [&](std::size_t axis) {
        const auto& list = report["mesh"]["size"].items;
        return axis < list.size() ? list[axis].number : 0;
    };
    std::string given;
    if (const double all = prepared["photographs"].number; all > report["training_views"].number)
        given = str(" of ", all);
    spdlog::info("Reconstructed {}{}: {}, mesh of {}, {:.3g} x {:.3g} x {:.3g} {}",
                 count_of(report["training_views"], "photograph"), given,
                 count_of(report["splats"], "splat"), count_of(report["mesh"]["faces"], "face"),
                 sides(0), sides(1), sides(2),
                 report["mesh"]["unit"].text == "metres" ? "metres" : "units of the scene");
    const JsonValue& placed = prepared["georeference"];
    if (const double fitted = placed["rmse_m"].number_or(-1); fitted >= 0) {
        const double checked = placed["checkpoint_rmse_m"].number_or(-1);
        spdlog::info("Place: known points are off by {:.3g} m (RMS){}", fitted,
                     checked < 0 ? "" : fmt::format(", checkpoints by {:.3g} m", checked));
    }
    if (!verdict.level.empty()) spdlog::info("Quality: {}", verdict.level);
    for (const std::string& limit : verdict.limits) spdlog::info("Limit: {}", limit);
    if (!verdict.limits.empty())
        for (const std::string& next : verdict.next) spdlog::info("Photograph next: {}", next);
    spdlog::info("Mesh: {}\nPage: {}\nReport: {}/report.html", mesh, page, run);
    say_next({"tvsgs-export", run, "splats.spz"}, "write the splats for other viewers");
}

class Reconstruction {
public:
    /// Checks the input and the folder of the result. Throws Error before anything is written.
    explicit Reconstruction(const Arguments& a);
    int run();

private:
    std::string program(const StageKind& kind) const { return (programs_ / kind.program).string(); }
    Words words(const StageKind& kind) const;
    std::string recorded_command(const StageKind& kind) const;
    bool is_done(const StageKind& kind) const;
    bool is_of_these_photographs(const std::string& recorded) const;
    void remove_results();
    void check_commands() const;
    void run_stage(const StageKind& kind, StageRunner& runner);

    const Arguments& a_;
    const std::string input_, out_, scene_, run_, page_;  // absolute
    fs::path programs_;
    std::string photographs_;  // that need cameras: count and bytes; empty: a scene has them
    std::vector<const StageKind*> stages_;
    std::optional<Record> record_;
};

Reconstruction::Reconstruction(const Arguments& a)
    : a_(a),
      input_(absolute(a.photos)),
      out_(absolute(a.out)),
      scene_(out_ + "/scene"),
      run_(out_ + "/run"),
      page_(out_ + "/view.html"),
      programs_(fs::read_symlink("/proc/self/exe").parent_path()) {
    // 1. The input.
    if (!fs::exists(input_)) throw input_error(a.photos, ": no such folder or video");
    const bool folder = fs::is_directory(input_);
    if (!folder && !prepare::is_video(input_))
        throw input_error(a.photos,
                          ": expected a folder or a video (.mp4, .mov, .avi, .mkv, .webm)");
    const bool has_cameras = folder && layout_of(input_);
    if (!folder) photographs_ = counted(fs::file_size(input_), "byte");
    if (folder && !has_cameras) {
        const std::vector<std::string> files = prepare::photo_files(input_);
        std::uintmax_t bytes = 0;
        for (const std::string& file : files) bytes += fs::file_size(fs::path(input_) / file);
        photographs_ = str(counted(files.size(), "photograph"), ", ", counted(bytes, "byte"));
        if (const std::string model = prepare::find_model_of(input_); !model.empty())
            throw usage_error(a.photos, ": these photographs have cameras, in ", model,
                              "; give the folder of that scene");
    }
    if (has_cameras && !a.of_prepare.empty())
        throw usage_error(a.photos, ": has cameras already, ", a.of_prepare.front(),
                          " is for photographs without; run tvsgs-prepare with it first");
    stages_ = has_cameras ? std::vector{&kTrain, &kMesh, &kView}
                          : std::vector{&kPrepare, &kTrain, &kMesh, &kView};
    for (const StageKind* stage : stages_)
        if (access(program(*stage).c_str(), X_OK) != 0)
            throw usage_error(program(*stage), ": not installed; install the package ",
                              stage == &kPrepare ? "tvsgs-prepare" : "tvsgs");

    // 2. The result.
    if (lies_in(out_, input_))
        throw usage_error(a.out, ": lies inside ", a.photos, "; choose a folder elsewhere");
    const bool exists = fs::exists(fs::symlink_status(out_));
    if (exists && !fs::is_directory(out_)) throw usage_error(a.out, ": is a file; choose a folder");
    record_.emplace(out_);
    if (exists && record_->is_new() && !fs::is_empty(out_))
        throw usage_error(a.out, ": has other files; choose another folder");
    if (!a.overwrite) check_commands();
}

/// The command of a stage, without the flags of the machine.
Words Reconstruction::words(const StageKind& kind) const {
    if (&kind == &kPrepare) {
        Words words{kind.program, input_, scene_};
        words.insert(words.end(), a_.of_prepare.begin(), a_.of_prepare.end());
        return words;
    }
    if (&kind == &kMesh) return {kind.program, run_};
    if (&kind == &kView) return {kind.program, run_, "--out", page_};
    const std::string scene = stages_.front() == &kPrepare ? scene_ : input_;
    Words words{kind.program, "--scene", scene, "--out", run_};
    const std::optional<SceneLayout> layout = layout_of(scene);
    if (!layout) throw input_error(scene, ": no cameras");
    int width = 0;  // of the narrowest photograph
    for (const auto& [id, camera] : layout->model.cameras)
        width = width == 0 ? camera.width_px : std::min(width, camera.width_px);
    const auto add = [&](const char* flag, auto value) {
        words.insert(words.end(), {flag, str(value)});
    };
    if (a_.resolution)
        add("--resolution", *a_.resolution);
    else if (a_.quality == "draft" && width > 800)
        add("--resolution", 800);
    else if (a_.quality == "best" && width > 1600)
        add("--resolution", std::min(width, 3200));
    if (a_.quality == "draft") add("--iterations", 800);
    if (a_.time_budget > 0) add("--time-budget", a_.time_budget);
    words.push_back("--resume");  // starts the run, or continues it
    return words;
}

/// A change of this text makes the results of the stage invalid.
std::string Reconstruction::recorded_command(const StageKind& kind) const {
    const std::string line = shell_line(words(kind));
    return &kind == &kPrepare ? str(line, "  # ", photographs_) : line;
}

/// Whether a recorded search for cameras had the same photographs, with any flags.
bool Reconstruction::is_of_these_photographs(const std::string& recorded) const {
    return recorded.starts_with(shell_line({kPrepare.program, input_, scene_})) &&
           recorded.ends_with("  # " + photographs_);
}

/// All but the page may also have been made by hand.
bool Reconstruction::is_done(const StageKind& kind) const {
    if (&kind == &kPrepare) return fs::exists(scene_ + "/prepare.json") && layout_of(scene_);
    if (&kind == &kTrain) return is_trained(run_);
    if (&kind == &kMesh) return is_meshed(run_);
    return record_->is_done(kind.name) && fs::exists(page_);
}

void Reconstruction::check_commands() const {
    for (const StageKind* stage : stages_) {
        const Record::Stage* const was = record_->find(stage->name);
        const bool is_kept = was != nullptr && (was->done || stage == &kTrain || is_done(*stage));
        if (!is_kept) continue;
        if (stage == &kTrain && stages_.front() == &kPrepare && !is_done(kPrepare))
            throw usage_error(a_.out, ": has a run, but its scene/ is missing or damaged; put it ",
                              "back, or start anew with --overwrite");
        if (stage == &kPrepare && !was->done && is_of_these_photographs(was->command))
            continue;  // made by hand after a failure, perhaps with other flags
        if (const std::string now = recorded_command(*stage); now != was->command)
            throw usage_error(a_.out, ": was made by another command:\n  before: ", was->command,
                              "\n  now:    ", now,
                              "\n  --overwrite starts anew; or choose another folder");
    }
}

/// Removes what an earlier call wrote. Keeps other files, and a scene that was made by hand.
void Reconstruction::remove_results() {
    const Record::Stage* const prepared = record_->find(kPrepare.name);
    if (stages_.front() == &kPrepare && fs::exists(scene_) && !has_manifest(scene_) &&
        (prepared == nullptr || !is_of_these_photographs(prepared->command)))
        throw usage_error(scene_, ": was made by hand from other photographs; move it away");
    if (has_manifest(scene_) && !lies_in(input_, scene_))
        for (const auto& entry : fs::recursive_directory_iterator(scene_))
            if (!entry.is_directory() && entry.path().filename() != kManifestName &&
                !is_listed(scene_, entry.path()))
                throw usage_error(entry.path().string(),
                                  ": is not a file of ours; move it away before --overwrite");
    require_replaceable(page_);
    for (const std::string& folder : {run_, scene_}) {
        if (!has_manifest(folder) || lies_in(input_, folder)) continue;
        remove_listed_files(folder);
        std::error_code not_empty;
        fs::remove(folder, not_empty);
    }
    fs::remove(page_);
    fs::remove(out_ + "/reconstruct.log");
}

void Reconstruction::run_stage(const StageKind& kind, StageRunner& runner) {
    record_->start(kind.name, recorded_command(kind));
    Words command = words(kind);
    command.front() = program(kind);
    Words flags = a_.of_machine;
    if (&kind == &kTrain || &kind == &kMesh) flags.insert(flags.end(), {"--device", a_.device});
    if (&kind == &kTrain) flags.emplace_back("--no-report");  // the mesh stage writes it
    command.insert(command.begin() + 1, flags.begin(), flags.end());
    const StageRunner::End end = runner.run(kind, command);
    if (end.code == 0) {
        if (&kind == &kPrepare) list_files(scene_);
        record_->finish(kind.name);
        spdlog::info("{}: done in {}", kind.title, clock_text(end.seconds));
    }
    if (SignalGuard::received() != 0) {
        spdlog::info("Stopped; the same command {}", &kind == &kPrepare && end.code != 0
                                                         ? "searches the cameras anew"
                                                         : "continues");
        SignalGuard::check();
    }
    if (end.code != 0)
        throw Error(static_cast<ExitCode>(end.code),
                    str(kind.title, ": ", kind.program, " failed, ", ending_text(end.code),
                        end.message.empty() ? "" : ": ", end.message, "\n  All messages: ", a_.out,
                        "/reconstruct.log"));
}

int Reconstruction::run() {
    const SignalGuard signals;
    fs::create_directories(out_);
    const FolderLock lock(out_);
    if (lock.held()) throw usage_error(a_.out, ": another tvsgs-reconstruct works there; wait");
    record_.emplace(out_);  // another process may have changed it before the lock
    if (a_.overwrite) remove_results();
    if (a_.overwrite || record_->is_new()) record_->clear();

    const bool prepared = stages_.front() == &kPrepare;
    StageRunner runner(stages_, out_ + "/reconstruct.log");
    std::string kept;
    bool all_kept = true;
    for (const StageKind* stage : stages_) {
        all_kept = all_kept && is_done(*stage);
        if (all_kept) {
            kept += (kept.empty() ? "" : ", ") + stage->title;
            continue;
        }
        if (!kept.empty()) spdlog::info("Kept from an earlier call: {}", std::exchange(kept, ""));
        run_stage(*stage, runner);
    }
    if (all_kept) spdlog::info("Everything is done already; --overwrite starts anew");
    if (prepared && !a_.of_prepare.empty() && !fs::exists(scene_ + "/georeference.json"))
        spdlog::warn(
            "{} has no effect: {} has its cameras from another command; to find them anew, "
            "move it away and give --overwrite",
            a_.of_prepare[0], scene_);
    if (runner.warnings() > 0)
        spdlog::info("{} in {}/reconstruct.log", counted(std::size_t(runner.warnings()), "warning"),
                     a_.out);
    log_summary(a_.out + "/run", prepared ? scene_ : input_, a_.out + "/view.html");
    if (a_.open) open_page(page_);
    return 0;
}

}  // namespace

int command(int argc, char** argv) {
    const Arguments a = parse(argc, argv);
    return Reconstruction(a).run();
}

}  // namespace tvsgs
