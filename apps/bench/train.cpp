#include "apps/bench/train.h"

#include <algorithm>

#include "apps/bench/stats.h"
#include "core/device/device_choice.h"
#include "core/device/threads.h"
#include "io/files/atomic_file.h"
#include "pipeline/run/signals.h"
#include "pipeline/run/view_evaluation.h"
#include "pipeline/scene/initial_points.h"
#include "pipeline/scene/planned_scene.h"

namespace tvsgs {
namespace {

/// When the mean PSNR of the test views was first seen at `psnr` or above.
struct Reached {
    double psnr, seconds = -1;  // -1: not reached
    int iteration = 0;
};

struct TrainTimes {
    double setup_s = 0, seconds = 0, last_psnr = std::nan("");
    int gaussians = 0;
    std::vector<StageTime> stages;
    double stages_of_s = 0;  // time in which they fell
};

/// Runs while it is not paused.
class PausingClock {
public:
    double seconds() const { return (paused_ ? at_pause_ : watch_.ms()) / 1e3 - lost_; }
    void pause() { at_pause_ = watch_.ms(), paused_ = true; }
    void resume() { lost_ += (watch_.ms() - at_pause_) / 1e3, paused_ = false; }

private:
    Stopwatch watch_;
    double at_pause_ = 0, lost_ = 0;
    bool paused_ = false;
};

/// One training. With `profile` it waits around each stage; else it looks for `wanted` in between,
/// which does not count.
template <class Device>
TrainTimes train_once(const Scene& scene,
                      const TrainOptions& options,
                      bool profile,
                      int psnr_every,
                      std::vector<Reached>& wanted) {
    TrainTimes out;
    PausingClock clock;
    double begin = -1;
    TrainCallbacks callbacks;
    callbacks.profile = profile;
    callbacks.stop_requested = [&] {
        SignalGuard::check();
        if (begin < 0) synchronize(Device{}), begin = clock.seconds();
        return false;
    };
    callbacks.report_due = [&](int step) { return profile && step == options.iterations; };
    callbacks.on_report = [&](const TrainReport& report) {
        out.stages = report.stages;
        out.stages_of_s = clock.seconds() - begin;
    };
    const auto look = [&](int step, const Gaussians<Device>& splats) {
        if (profile || wanted.empty() || (step % psnr_every != 0 && step != options.iterations))
            return;
        synchronize(Device{});
        clock.pause();
        const auto no_pictures = [](const View&, const ImageU8&, const auto&) {};
        out.last_psnr = score_views(splats, scene.test, options, no_pictures).mean_psnr;
        for (Reached& r : wanted)
            if (r.seconds < 0 && out.last_psnr >= r.psnr)
                r.seconds = clock.seconds() - begin, r.iteration = step;
        synchronize(Device{});
        clock.resume();
    };
    const Gaussians<Device> gaussians = train<Device>(scene, options, callbacks, look);
    synchronize(Device{});
    out.setup_s = begin;
    out.seconds = clock.seconds() - begin;
    out.gaussians = gaussians.size();
    return out;
}

JsonValue psnr_json(const std::vector<Reached>& wanted) {
    JsonValue list = JsonValue::list();
    for (const Reached& r : wanted)
        list.items.push_back(JsonValue()
                                 .add("psnr", r.psnr)
                                 .add("seconds", r.seconds < 0 ? JsonValue() : r.seconds)
                                 .add("iteration", r.seconds < 0 ? JsonValue() : r.iteration));
    return list;
}

/// Sum of the stages.
double total(const std::vector<StageTime>& stages) {
    double sum = 0;
    for (const StageTime& s : stages) sum += s.seconds;
    return sum;
}

JsonValue stages_json(const TrainTimes& t, int iterations) {
    JsonValue list = JsonValue::list();
    for (const StageTime& s : t.stages)
        list.items.push_back(JsonValue()
                                 .add("stage", s.name)
                                 .add("seconds", s.seconds)
                                 .add("ms_per_iteration", 1e3 * s.seconds / iterations)
                                 .add("share", s.seconds / t.stages_of_s));
    return list;
}

void print(const TrainTimes& plain,
           const TrainTimes& profiled,
           const std::vector<Reached>& wanted,
           int iterations) {
    std::fprintf(stderr, "  %-24s %10s %14s %8s\n", "stage", "s", "ms/iteration", "share");
    const auto row = [&](const char* name, double seconds) {
        std::fprintf(stderr, "  %-24s %10.3f %14.3f %7.2f%%\n", name, seconds,
                     1e3 * seconds / iterations, 100 * seconds / profiled.stages_of_s);
    };
    for (const StageTime& s : profiled.stages) row(s.name, s.seconds);
    row("unaccounted", profiled.stages_of_s - total(profiled.stages));
    row("all, profiled", profiled.stages_of_s);
    row("all, without waits", plain.seconds);
    for (const Reached& r : wanted)
        if (r.seconds < 0)
            std::fprintf(stderr, "  PSNR %g dB: not reached; %.2f dB at the end\n", r.psnr,
                         plain.last_psnr);
        else
            std::fprintf(stderr, "  PSNR %g dB: %.3f s, iteration %d\n", r.psnr, r.seconds,
                         r.iteration);
}

}  // namespace

TrainBench::TrainBench(CLI::App& app)
    : command_(
          app.add_subcommand("train", "time a real training by stage, and the seconds to a PSNR")),
      flags_(*command_, table_) {
    options_.add_to(table_);
    CLI::App& c = *command_;
    flags_.add_scene();
    flags_.add("--init-ply", "scene.init_ply",
               "start from this cloud instead of the points of the scene", "Scene");
    flags_.add("--iterations", "iterations", "training iterations", "Training");
    flags_.add("--seed", "seed", "seed of all random numbers", "Training");
    c.add_option("-c,--config", configs_, "JSON file; later files win")->expected(1)->take_all();
    c.add_option("--set", settings_, "any key of the configuration")->expected(1)->take_all();
    c.add_option("--psnr", psnr_,
                 "PSNR values P,P,... of the test views: print the seconds to reach each")
        ->delimiter(',');
    c.add_option("--psnr-every", psnr_every_,
                 "iterations between measurements of the PSNR, not timed [a hundredth of all]")
        ->check(CLI::Range(1, 1'000'000'000));
    c.add_option("--device", device_, "auto, cpu, cuda or cuda:N")->capture_default_str();
    add_output_flag(c, "--out", out_, "JSON file for the results, too");
    c.add_flag("--quiet", quiet_, "warnings and errors only");
}

int TrainBench::run() {
    RunOptions& options = options_;
    for (const std::string& file : configs_) table_.read_file(file);
    table_.read_environment();
    flags_.set_keys(table_);
    table_.set_all(settings_);
    if (options.scene.path.empty())
        throw Error(ExitCode::usage, "no scene given; give --scene DIR");
    const int iterations = options.train.iterations;
    if (iterations < 1)
        throw Error(ExitCode::usage, str("iterations is ", iterations, "; expected 1 or more"));
    const SignalGuard signals;
    const DeviceChoice device = choose_device(device_);
    options.scene.points_required = options.train.init.min_points == 0;
    Scene scene = read_scene(options.scene);
    if (!psnr_.empty() && scene.test.empty())
        throw Error(ExitCode::usage, str("--psnr: ", options.scene.path,
                                         " has no test views; give --eval or --split LIST"));
    check_masks(options.train.loss.photometric, scene.train);
    limit_to_object(options.train.loss.photometric.masks, scene.train, scene.points);
    read_fixed_points(options, scene);
    provide_maps(device, options, prepare_points(device, options, scene), scene);

    std::vector<Reached> wanted;
    for (const double psnr : psnr_) wanted.push_back({psnr});
    const int every = psnr_every_ > 0 ? psnr_every_ : std::max(1, iterations / 100);
    TrainTimes plain, profiled;
    on_device(device, [&](auto tag) {
        using Device = decltype(tag);
        plain = train_once<Device>(scene, options.train, false, every, wanted);
        profiled = train_once<Device>(scene, options.train, true, every, wanted);
    });
    const Camera& camera = scene.train.front().camera;
    JsonValue json;
    json.add("bench", "train")
        .add("version", kVersion)
        .add("device", device.description)
        .add("threads", thread_count())
        .add("scene", options.scene.path)
        .add("views", scene.train.size())
        .add("width", camera.width_px)
        .add("height", camera.height_px)
        .add("points", scene.points.positions.size())
        .add("iterations", iterations)
        .add("gaussians", plain.gaussians)
        .add("setup_s", plain.setup_s)
        .add("seconds", plain.seconds)
        .add("ms_per_iteration", 1e3 * plain.seconds / iterations)
        .add("psnr", plain.last_psnr)
        .add("reached", psnr_json(wanted))
        .add("profiled_seconds", profiled.stages_of_s)
        .add("stages", stages_json(profiled, iterations))
        .add("unaccounted_share", 1 - total(profiled.stages) / profiled.stages_of_s);
    std::printf("%s\n", json_text(json).c_str());
    if (!out_.empty())
        write_text_file(out_, json_text(json) + "\n"), spdlog::info("Results: {}", out_);
    if (!quiet_) print(plain, profiled, wanted, iterations);
    return static_cast<int>(ExitCode::done);
}

}  // namespace tvsgs
