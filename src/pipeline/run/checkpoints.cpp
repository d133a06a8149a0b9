#include "pipeline/run/checkpoints.h"

#include <algorithm>
#include <charconv>
#include <cstring>
#include <filesystem>

#include "core/device/buffer.h"
#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"
#include "io/files/checkpoint.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kKept = 2;

std::string folder_of(const std::string& run) {
    return run + "/checkpoints";
}

/// Iteration and path, newest first.
std::vector<std::pair<int, std::string>> checkpoints_of(const std::string& run) {
    std::vector<std::pair<int, std::string>> found;
    std::error_code code;
    for (fs::directory_iterator it(folder_of(run), code), end; !code && it != end;
         it.increment(code)) {
        const std::string name = it->path().filename().string(), prefix = "iteration_";
        int iteration = -1;
        const char* const end_of_name = name.data() + name.size();
        if (!name.starts_with(prefix)) continue;
        const auto number = std::from_chars(name.data() + prefix.size(), end_of_name, iteration);
        if (number.ec == std::errc{} && std::string_view(number.ptr, end_of_name) == ".ckpt")
            found.emplace_back(iteration, it->path().string());
    }
    std::sort(found.rbegin(), found.rend());
    return found;
}

template <class T>
void add_values(State& state, const char* name, const T* values, std::size_t count) {
    StateArray& array = state.add(name, sizeof(T), count, false);
    if (count > 0) std::memcpy(array.bytes.data(), values, array.bytes.size());
}

template <class T>
std::vector<T> values_of(const State& state, const char* name) {
    const StateArray& array = state.get(name, sizeof(T));
    std::vector<T> values(array.count());
    if (!values.empty()) std::memcpy(values.data(), array.bytes.data(), array.bytes.size());
    return values;
}

template <class T>
T value_of(const State& state, const char* name) {
    T value;
    std::memcpy(&value, state.get_one(name, sizeof(T)).bytes.data(), sizeof(T));
    return value;
}

/// Removes all but the newest checkpoints.
void keep_newest(const std::string& run) {
    const auto all = checkpoints_of(run);
    std::error_code code;
    for (std::size_t i = kKept; i < all.size(); ++i) fs::remove(all[i].second, code);
}

ResumePoint read_point(const std::string& file) {
    auto state = std::make_shared<State>(read_checkpoint(file));
    return with_context(str("reading ", file), [&] {
        ResumePoint point{file, {}, state, iterations_done(*state), {}, {}};
        point.seconds = value_of<double>(*state, "run.seconds");
        const std::vector<char> config = values_of<char>(*state, "run.config");
        point.config.assign(config.begin(), config.end());
        return point;
    });
}

/// Checksum of the names and poses of the training views; independent of the resolution.
std::uint32_t views_id(const Scene& scene) {
    std::uint32_t id = 0;
    for (const View& view : scene.train) {
        id = checksum(view.name.data(), view.name.size(), id);
        id = checksum(&view.camera.camera_from_world, sizeof view.camera.camera_from_world, id);
    }
    return id;
}

/// Checksum of every 16th row of the photographs, which distinguishes them at little cost.
std::uint32_t photos_id(const Scene& scene) {
    std::uint32_t id = 0;
    for (const View& view : scene.train) {
        const std::size_t row = std::size_t(view.photo.width) * 3;
        for (std::size_t at = 0; at + row <= view.photo.pixels.size(); at += 16 * row)
            id = checksum(view.photo.pixels.data() + at, row, id);
    }
    return id;
}

}  // namespace

std::optional<ResumePoint> open_checkpoint(const std::string& place) {
    std::error_code code;
    if (!fs::is_directory(place, code)) {
        ResumePoint point = read_point(place);
        const fs::path folder = fs::absolute(place).lexically_normal().parent_path();
        if (folder.filename() == "checkpoints" && fs::exists(folder / "../config.json", code))
            point.run = fs::relative(folder.parent_path(), code).string();
        return point;
    }
    std::optional<Error> first;
    for (const auto& [iteration, file] : checkpoints_of(place)) try {
            ResumePoint point = read_point(file);
            point.run = place;
            return point;
        } catch (const Error& error) {
            if (error.code() != ExitCode::input) throw;
            spdlog::warn("{}; trying the one before", error.what());
            if (!first) first = error;
        }
    if (first) throw *first;
    return std::nullopt;
}

void restore_scene(const ResumePoint& point, Scene& scene) {
    if (value_of<std::uint32_t>(*point.state, "run.views") != views_id(scene))
        throw input_error(point.file,
                          ": checkpoint of another scene: other names or poses than the ",
                          scene.train.size(), " training views of ", scene.path,
                          "; give the scene and views of the training");
    if (value_of<std::uint32_t>(*point.state, "run.photos") != photos_id(scene))
        spdlog::warn("{}: the photographs in {} have changed since this checkpoint", point.file,
                     scene.path);
    scene.points = {};
    scene.points.positions = values_of<Vec3f>(*point.state, "run.points");
    scene.extent = value_of<float>(*point.state, "run.extent");
}

void remove_checkpoints_after(const std::string& run, int done) {
    std::error_code code;
    for (const auto& [iteration, file] : checkpoints_of(run))
        if (iteration > done) fs::remove(file, code);
}

std::vector<std::pair<std::string, std::string>> config_values(const OptionTable& table) {
    std::vector<std::pair<std::string, std::string>> values;
    for (const Option& option : table.options()) values.emplace_back(option.key, option.get());
    return values;
}

JsonValue changed_values(const std::vector<std::pair<std::string, std::string>>& before,
                         const OptionTable& table) {
    JsonValue changed = JsonValue::object();
    const auto now = config_values(table);
    for (std::size_t i = 0; i < std::min(before.size(), now.size()); ++i)
        if (before[i].second != now[i].second)
            changed.add(now[i].first, str(before[i].second, " -> ", now[i].second));
    return changed;
}

void CheckpointWriter::save(int done, double seconds, const SharedState& state) {
    finish();
    if (!photos_) photos_ = photos_id(scene_);
    auto about = std::make_shared<State>();
    add_values(*about, "run.config", config_.data(), config_.size());
    add_values(*about, "run.seconds", &seconds, 1);
    const std::uint32_t views = views_id(scene_);
    add_values(*about, "run.views", &views, 1);
    add_values(*about, "run.photos", &*photos_, 1);
    add_values(*about, "run.extent", &scene_.extent, 1);
    add_values(*about, "run.points", scene_.points.positions.data(),
               scene_.points.positions.size());
    file_ = str(folder_of(run_), "/iteration_", done, ".ckpt");
    auto write = [about = SharedState(std::move(about)), whole = state, file = file_,
                  run = run_]() mutable -> std::string {
        // Frees the state after the write, not at the next checkpoint.
        const auto values = std::move(about), splats = std::move(whole);
        try {
            write_checkpoint(file, {values.get(), splats.get()});
        } catch (const std::exception& error) {
            return error.what();
        }
        keep_newest(run);
        return {};
    };
    writing_ = std::async(std::launch::async, std::move(write));
}

std::optional<std::string> CheckpointWriter::finish() {
    if (writing_.valid()) {
        failure_ = writing_.get();
        if (!failure_.empty())
            spdlog::warn("Checkpoint not saved: {}; older ones are kept", failure_);
    }
    if (file_.empty() || !failure_.empty()) return std::nullopt;
    return file_;
}

Resume open_resume(const std::string& given, std::string& out, OptionTable& table) {
    Resume resume;
    resume.asked = true;
    const std::string place = given.empty() ? out : given;
    std::error_code code;
    if (place.empty()) throw Error(ExitCode::usage, "--resume: no run given; give --resume RUN");
    if (!given.empty() || fs::is_directory(place, code)) resume.point = open_checkpoint(place);
    const std::string run = resume.point ? resume.point->run : place;
    if (out.empty()) out = run;
    resume.same_run = run == out || fs::equivalent(run, out, code);
    if (resume.point) {
        table.read_text(resume.point->file, resume.point->config);
        resume.configured = config_values(table);
    }
    const std::string config = out + "/config.json";
    if (resume.same_run && fs::exists(config, code)) table.read_file(config);
    return resume;
}

bool is_configured(const Resume& resume, const std::string& out) {
    std::error_code code;
    return resume.asked && (resume.point || fs::exists(out + "/config.json", code));
}

void check_resume(const Resume& resume,
                  const std::string& out,
                  bool overwrite,
                  const TrainOptions& train) {
    if (!overwrite && resume.in_place() && !resume.point && holds_splats(out))
        throw Error(ExitCode::usage, "--resume: ", out,
                    " has splats but no checkpoint, so it cannot continue; give another run, "
                    "or --overwrite to remove it and start from the beginning");
    if (!resume.point) return;
    if (train.iterations <= resume.done())
        throw Error(ExitCode::usage, resume.point->file, ": already trained for ",
                    grouped(resume.done()), " iterations; give more, such as --iterations ",
                    2 * resume.done());
    for (const auto& [key, value] : resume.configured)
        if (key == "backbone" && value != train.backbone)
            throw Error(ExitCode::usage, resume.point->file, ": splats of backbone '", value,
                        "', but the configuration has '", train.backbone,
                        "'; give --set backbone=", value, ", or start a new run without --resume");
}

void log_resume(const Resume& resume, const JsonValue& changed, RunFolder& run) {
    if (resume.point) {
        const ResumePoint& point = *resume.point;
        if (resume.in_place()) remove_checkpoints_after(run.path(), point.done);
        run.log(JsonValue()
                    .add("event", "resumed")
                    .add("iteration", point.done)
                    .add("seconds", point.seconds)
                    .add("checkpoint", point.file)
                    .add("changed", changed));
        spdlog::info("{}: {} iterations are done; changed since: {}", point.file,
                     grouped(point.done), json_text(changed));
    } else if (resume.asked) {
        spdlog::info("{}: no checkpoint yet; starts from the beginning", run.path());
    }
}

}  // namespace tvsgs
