#include "pipeline/run/train_session.h"

#include <future>

#include "core/grouped.h"
#include "core/log.h"
#include "io/splats/ply.h"
#include "optim/growth/fixed_splats.h"
#include "optim/loop/schedule.h"
#include "pipeline/run/checkpoints.h"
#include "pipeline/run/live_snapshots.h"
#include "pipeline/run/progress.h"
#include "pipeline/run/refined_cameras.h"
#include "pipeline/run/signals.h"
#include "pipeline/run/surface_motion.h"
#include "pipeline/run/train_evaluation.h"
#include "pipeline/run/view_evaluation.h"
#include "pipeline/scene/exposures.h"

namespace tvsgs {
namespace {

/// Whether test views decide when the training ends.
bool ends_by_score(const SessionInputs& in) {
    return in.options.plan.until == Until::converged && !in.scene.test.empty();
}

/// Whether an evaluation may be due after a step.
bool evaluates_while_training(const SessionInputs& in) {
    return !in.options.eval.at.empty() || in.options.eval.every > 0 || ends_by_score(in);
}

template <class Device>
class TrainSession {
public:
    TrainSession(const SessionInputs& inputs, SharedState start, RunFolder& run)
        : in_(inputs),
          run_(run),
          configured_(inputs.options),
          training_(inputs.training),
          progress_(training_, inputs.resume.seconds()),
          checkpoints_(run.path(), config(), inputs.scene),
          live_(run.path(), inputs.scene.origin, inputs.session.live_every),
          budget_(inputs.options.plan.time_budget, training_, inputs.resume.done()),
          scores_(inputs.options.eval, ends_by_score(inputs), progress_.seconds()),
          fixed_(inputs.scene.fixed_splats, inputs.training.model.sh_degree),
          done_(inputs.resume.done()),
          state_(std::move(start)) {
        if (in_.options.plan.until == Until::converged && !ends_by_score(in_))
            surface_.emplace(in_.scene.train, training_);
    }

    void run() {
        warn_of_limit();
        log_scored_pixels();
        TrainCallbacks told = callbacks();
        Gaussians<Device> trained;
        try {
            for (;;) {
                trained = train<Device>(
                    in_.scene, training_, told,
                    [this](int step, const Gaussians<Device>& splats) { after_step(step, splats); },
                    std::exchange(state_, nullptr));
                if (!fit_now_) break;
                trained = {};  // state_ has a copy
                fit_to_budget();
                told.goes_on = true;
            }
        } catch (const Error& error) {
            end_progress_line();
            const auto last = checkpoints_.finish();
            if (!last) throw;
            throw Error(error.code(), str(error.what(), "\n  the last checkpoint is ", *last,
                                          "; --resume continues from there"));
        }
        synchronize(Device{});
        end_progress_line();
        finish(trained, progress_.seconds());
    }

private:
    // During the training.

    TrainCallbacks callbacks() {
        TrainCallbacks told;
        told.profile = in_.session.profile;
        told.report_due = [this](int step) {
            return step == 1 || step == training_.iterations ||
                   step % in_.session.report_every == 0;
        };
        told.on_report = [this](const TrainReport& report) {
            follow_folder();
            run_.log(progress_.json(report));
            progress_.show(report);
        };
        told.stop_requested = [this] { return stop_requested(); };
        told.on_end = [this](int done) { done_ = done; };
        told.save_due = [this](int done) {
            const int every = in_.session.checkpoint_every;
            return every > 0 && done > in_.resume.done() &&
                   (done % every == 0 || done + 1 == training_.iterations);
        };
        told.on_save = [this](int done, const SharedState& state) {
            state_ = state;
            if (!fit_now_) checkpoints_.save(done, progress_.seconds(), state);
        };
        told.on_cameras = [this](const CameraRefinement& refined) { refined_ = refined; };
        told.on_exposures = [this](const HeldExposures& found) { exposures_ = found; };
        told.on_rollback = [this](int done, const std::string& why) {
            done_ = done;
            spdlog::warn(why);
            run_.log(JsonValue().add("event", "rollback").add("iteration", done).add("why", why));
        };
        return told;
    }

    void after_step(int step, const Gaussians<Device>& splats) {
        done_ = step;
        if (surface_ && surface_->due(step)) surface_->look(fixed_.join(splats));
        if (evaluates_while_training(in_)) evaluate_if_due(step, splats);
        if (!live_.due()) return;
        Gaussians<Cpu> now;
        copy(splats, now);
        live_.write(step, training_.iterations, progress_.seconds(), std::move(now));
    }

    void follow_folder() {
        if (!run_.follow()) return;
        checkpoints_.set_run(run_.path());
        live_.set_run(run_.path());
        spdlog::warn("The run folder was moved; the training goes on in {}", run_.path());
    }

    bool stop_requested() {
        const bool stop = SignalGuard::received() != 0 || scores_.convergence().over ||
                          (surface_ && surface_->still());
        fit_now_ = !stop && budget_.due(done_, own_seconds());
        return stop || fit_now_;
    }

    void evaluate_if_due(int step, const Gaussians<Device>& splats) {
        if (!scores_.due(step, progress_.seconds()) || step == training_.iterations) return;
        synchronize(Device{});
        progress_.pause();
        evaluate_now(step, splats);
        progress_.resume();
    }

    void evaluate_now(int step, const Gaussians<Device>& splats) {
        const MeshSource mesh = mesh_source();
        const std::vector<Camera> given = detail::cameras_of(in_.scene.train);
        if (refined_) place_cameras(refined_->cameras());
        const Evaluation evaluation =
            evaluate(step, progress_.seconds(), splats, fixed_.join(splats), in_.scene.test,
                     training_, in_.truth, in_.options.eval.mesh ? &mesh : nullptr);
        place_cameras(given);  // from which the next train() starts
        run_.log(evaluation.line);
        scores_.add(evaluation.psnr);
    }

    void place_cameras(const std::vector<Camera>& cameras) const {
        for (std::size_t i = 0; i < cameras.size(); ++i) in_.scene.train[i].camera = cameras[i];
    }

    void fit_to_budget() {
        budget_.fit(done_, own_seconds(), training_);
        copy_schedule(training_, configured_.train);
        progress_.set_schedule(training_);
        run_.save_config(config());
        checkpoints_.set_config(config());
        run_.log(JsonValue()
                     .add("event", "plan")
                     .add("iteration", done_)
                     .add("seconds", progress_.seconds())
                     .add("iterations", training_.iterations));
        spdlog::debug("After {:.1f} s: {} iterations fit into {:g} s at this speed",
                      progress_.seconds(), grouped(training_.iterations),
                      double(in_.options.plan.time_budget));
    }

    std::string config() const { return config_json(configured_, in_.info); }

    // After the training, which took `seconds`.

    void finish(const Gaussians<Device>& trained, double seconds) {
        follow_folder();
        finish_budget(seconds);
        Gaussians<Cpu> splats;
        copy(trained, splats);
        warn_of_few(splats.size());
        const bool discs = in_.options.output.ply_scales == OutputOptions::Scales::automatic &&
                           make_backbone<Cpu>(training_.backbone, training_.render)->traits.flat;
        live_.finish();
        // The splats and the last checkpoint are written while the test views are scored.
        std::future<void> saving = std::async(std::launch::async, [&] {
            run_.save_splats(splats, done_, in_.scene.origin,
                             discs ? PlyScales::two : PlyScales::three);
        });
        if (refined_) save_refined_cameras();
        if (!exposures_.empty()) write_exposures(run_.path(), in_.scene, exposures_);
        if (SignalGuard::received() != 0) saving.get();
        log_end(seconds);
        SignalGuard::check();

        const JsonValue summary = write_results(trained, seconds);
        if (saving.valid()) saving.get();
        run_.remove_splats_of_stops(done_);
        run_.log(summary);
        in_.write_report();
        checkpoints_.finish();
        spdlog::debug("{} splats after {} iterations in {:.1f} s, peak {} MiB",
                      grouped(splats.size()), done_, seconds,
                      memory_use(Device{}).peak_bytes >> 20);
        if (!checkpoints_.failure().empty())
            throw Error(ExitCode::io, run_.path(),
                        ": the run is complete, but --resume cannot extend it: "
                        "the last checkpoint was not saved: ",
                        checkpoints_.failure());
    }

    void finish_budget(double seconds) {
        const double asked = in_.options.plan.time_budget, took = seconds - in_.resume.seconds();
        if (!(asked > 0) || done_ != training_.iterations) return;
        if (took > 1.1 * asked)
            spdlog::warn(
                "Time budget exceeded: {:.1f} s instead of {:g} s for {} iterations; give more "
                "time, or smaller images (-r)",
                took, asked, grouped(done_));
        // A run that repeats this one repeats its schedule.
        configured_.plan.time_budget = 0;
        run_.save_config(config());
    }

    void warn_of_few(int splats) const {
        const std::size_t first = in_.scene.points.positions.size();
        if (std::size_t(splats) < first / 100)
            spdlog::warn(
                "Only {} splats are left of {} start points: learning rates (lr.*) or pruning "
                "(densify.*) do not suit this scene",
                grouped(splats), grouped(first));
    }

    void log_end(double seconds) {
        const Convergence& convergence = scores_.convergence();
        if (convergence.over)
            spdlog::info(
                "Converged: the best PSNR, {:.2f} dB, was at {:.1f} s; stopped at {:.1f} s",
                convergence.best, convergence.best_at, seconds);
        else if (surface_ && surface_->still())
            spdlog::info(
                "Converged: in the last {} iterations half of the surface moved by less than "
                "{:.2g} px and 90 % of it by less than {:.2g} px; stopped after {} iterations, "
                "{:.1f} s",
                SurfaceWatch<Device>::kEvery, surface_->motion().median_px,
                surface_->motion().p90_px, grouped(done_), seconds);
        else if (done_ < training_.iterations) {
            const auto last = checkpoints_.finish();
            spdlog::warn("Stopped after {} of {} iterations; the splats are in {}", grouped(done_),
                         grouped(training_.iterations), run_.path());
            run_.log(JsonValue().add("event", "stopped").add("iteration", done_));
            if (!last) throw Error(ExitCode::io, checkpoints_.failure());
            if (in_.session.for_blocks)
                spdlog::warn("The same tvsgs-blocks command continues it");
            else
                spdlog::warn("Continue with:\n    tvsgs-train --resume {}", run_.path());
        }
    }

    void save_refined_cameras() const {
        place_cameras(refined_->cameras());
        write_refined_cameras(run_.path(), in_.scene);
        run_.save_cameras(in_.scene);
        spdlog::info("{}; cameras: {}/cameras", camera_moves_text(*refined_), run_.path());
    }

    JsonValue write_results(const Gaussians<Device>& trained, double seconds) {
        JsonValue summary;
        summary.add("event", "done")
            .add("iteration", done_)
            .add("seconds", seconds)
            .add("gaussians", trained.size());
        summary.add("peak_bytes", memory_use(Device{}).peak_bytes);
        if (refined_) summary.add("cameras", camera_moves_json(in_.scene, *refined_));
        if (!in_.scene.test.empty()) score_test_views(fixed_.join(trained), summary);
        if (in_.truth)
            add_scores(summary, "centres", score_points(to_host(trained.means), *in_.truth, true),
                       run_.path());
        if (in_.options.eval.mesh) {
            const MeshSource source = mesh_source();
            const TriangleMesh mesh =
                extract_mesh(source.views, fixed_.join(trained), training_, source.options,
                             source.spill_folder, source.origin);
            write_mesh_ply(run_.path() + "/mesh/mesh.ply", mesh, source.origin);
            add_scores(summary, "mesh", score_mesh(mesh, *in_.truth, true), run_.path());
        }
        return summary;
    }

    void warn_of_limit() const {
        const std::size_t first = in_.scene.points.positions.size();
        const int most = training_.densify.max_gaussians;
        if (done_ == 0 && first > std::size_t(most))
            spdlog::warn(
                "{} start points are more than {} splats (--max-gaussians), which limits only "
                "growth; --set init.max_points={} thins a start cloud by stereo or --init-ply",
                grouped(first), grouped(most), most);
    }

    void log_scored_pixels() const {
        const std::vector<View>& views = in_.scene.test;
        if (training_.loss.photometric.masks == MaskUse::object && have_masks(views) &&
            !has_object(views))
            spdlog::warn(
                "All masks of the {} test views are empty: PSNR is measured on whole images",
                views.size());
    }

    void score_test_views(const Gaussians<Device>& drawn, JsonValue& summary) const {
        const bool masked = have_masks(in_.scene.test);
        const ViewScores scores =
            evaluate_views(drawn, in_.scene, training_, run_.path(), {.masked = masked});
        summary.add("psnr", scores.mean_psnr).add("ssim", scores.mean_ssim);
        if (masked) summary.add("psnr_masked", scores.mean_masked.psnr);
        const double psnr = psnr_trained(scores, training_);
        spdlog::info("Test photographs: PSNR {:.1f} dB{}, SSIM {:.3f}: {}", scores.mean_psnr,
                     masked ? fmt::format(" (on the object {:.1f})", scores.mean_masked.psnr) : "",
                     scores.mean_ssim, psnr_level(psnr));
        if (psnr < scores_.best_psnr() - kClearlyWorse)
            spdlog::warn(
                "PSNR was {:.2f} dB after {} iterations and is {:.2f} dB at the end: the training "
                "was too long, or added too many splats; try --iterations {}, --until converged or "
                "--set densify.enabled=false",
                scores_.best_psnr(), scores_.best_step(), psnr, scores_.best_step());
    }

    /// Without the seconds before the run was resumed.
    double own_seconds() const { return progress_.seconds() - in_.resume.seconds(); }
    MeshSource mesh_source() const {
        return {in_.scene.train, in_.options.mesh, run_.path() + "/mesh", in_.scene.origin};
    }

    const SignalGuard signals_;  // from here on there is work to save
    const SessionInputs& in_;
    RunFolder& run_;
    RunOptions configured_;  // of config.json; a time budget changes the schedule
    TrainOptions training_;  // in_.training with the same schedule
    TrainProgress progress_;
    CheckpointWriter checkpoints_;
    LiveSnapshots live_;
    TimeBudget budget_;
    ScoreWatch scores_;                            // of the evaluations during the training
    std::optional<SurfaceWatch<Device>> surface_;  // ends the training; none: iterations or scores
    FixedSplats<Device> fixed_;                    // drawn beside the trained ones
    std::optional<CameraRefinement> refined_;      // the cameras' present poses; none: as given
    HeldExposures exposures_;                      // of the training views; empty: none
    int done_;                                     // iterations
    SharedState state_;     // the next train() starts there; null: from the scene
    bool fit_now_ = false;  // the training pauses for a new schedule
};

}  // namespace

void run_session(const DeviceChoice& device,
                 const SessionInputs& inputs,
                 SharedState start,
                 RunFolder& run) {
    on_device(device,
              [&](auto tag) { TrainSession<decltype(tag)>(inputs, std::move(start), run).run(); });
}

}  // namespace tvsgs
