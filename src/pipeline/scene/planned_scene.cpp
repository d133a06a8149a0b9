#include "pipeline/scene/planned_scene.h"

#include "core/grouped.h"
#include "io/config/config.h"
#include "pipeline/run/run_folder.h"
#include "pipeline/scene/exposures.h"
#include "pipeline/scene/initial_points.h"
#include "pipeline/scene/mask_use.h"
#include "pipeline/scene/sky.h"
#include "plan/decide.h"

namespace tvsgs {
namespace {

TrainOptions options_of(const char* config) {
    Configuration built_in;
    built_in.table.read_text("the program", built_in_config(config));
    return built_in.options.train;
}

bool takes_stereo(const PriorOptions& priors) {
    return priors.source == PriorOptions::Source::automatic ||
           priors.source == PriorOptions::Source::stereo;
}

/// Not on a CPU, where their iterations take several times as long, nor where the user asks for
/// another rasteriser or for an option that discs lack.
bool may_draw_discs(const DeviceChoice& device, const Configuration& asked) {
    if (!device.cuda || is_pinned(asked.table, "backbone")) return false;
    for (const TermOnList& term : terms_on_list(asked.options.train.loss))
        if (term.needs.thickness && term.weight > 0 &&
            is_pinned(asked.table, str("loss.", term.key, ".weight")))
            return false;
    try {
        make_backbone<Cpu>(kDiscs, asked.options.train.render);
        return true;
    } catch (const Error&) {  // of an option that discs lack
        return false;
    }
}

/// Not where the user gives other priors, or terms that need them.
bool may_take_normals(const Configuration& asked) {
    const RunOptions& options = asked.options;
    if (!takes_stereo(options.priors) || !options.priors.dir.empty() ||
        is_pinned(asked.table, "loss.prior_normal.weight"))
        return false;
    for (const TermOnList& term : terms_on_list(options.train.loss))
        for (const std::string_view map : term.needs.view_maps)
            if (term.weight > 0 && map != "mask") return false;
    return true;
}

/// The decision, unless another run has fitted the exposures.
Decision held_exposure(const Decision& decision, const RunOptions& options) {
    const std::string& run = options.train.loss.photometric.exposure_from;
    if (decision.name != "exposure" || run.empty()) return decision;
    return {"exposure", "held", str("fitted by ", run), NAN, NAN, {}, "exposure held"};
}

/// Prepares a run in three rounds: views, cloud, training. Each looks at the scene, decides if the
/// run is planned, and provides the results, which the next round looks at.
class Preparation {
public:
    Preparation(const DeviceChoice& device, const Configuration& asked, bool planned)
        : device_(device), config_(asked), planned_(planned) {}

    void read_views(bool resumed = false);
    void decide_cloud();
    void provide_cloud();
    void decide_training();
    void provide_gap_points();
    void decide_machines();
    void provide_training(bool priors);
    void provide_resumed(const ResumePoint& point);  // in place of rounds 2 and 3
    Resolved result() { return {std::move(scene_), options_, std::move(plan_)}; }

    /// Whether stereo made the start points.
    bool by_stereo() const { return !scene_.points.confidences.empty() && !stereo_.maps.empty(); }
    bool needs_stereo() const { return tvsgs::needs_stereo(options_, scene_); }
    void remark(const std::string& text) { plan_.remark(text); }

private:
    void decide_settings(const ChosenViews& chosen);
    void require_start() const;
    void look();
    TrainingInputs training_inputs() const;
    MachineInputs machine_inputs() const;

    bool pinned(const std::string& key) const { return is_pinned(config_.table, key); }
    template <class Decided>
    void apply(const Decided& decided) {
        plan_.apply(decided, config_.table);
    }

    const DeviceChoice& device_;
    Configuration config_;
    RunOptions& options_ = config_.options;
    PhotometricOptions& photometric_ = options_.train.loss.photometric;
    const bool planned_;
    bool dense_ = false;  // the settings that were chosen
    RunPlan plan_;
    Scene scene_;
    SceneLook look_;
    SkyDetection sky_;
    StereoStart stereo_;
};

// Round 1: the views.

void Preparation::read_views(bool resumed) {
    SceneOptions& o = options_.scene;
    const std::string& fixed = options_.train.init.fixed_splats;
    if (!resumed && !fixed.empty()) choose_backbone(fixed, options_.train.render, config_.table);
    // Stereo starts from the points that the scene comes with.
    if (resumed) o.need_points = !needs_of(options_.train.loss).view_maps.empty();
    o.points_required = !resumed && !planned_ && options_.train.init.min_points == 0;
    const ChosenViews chosen = choose_views(o);
    if (planned_) decide_settings(chosen);

    scene_ = load_scene(chosen, o);
    if (!resumed) check_photographs(scene_.train), check_poses(o.path, scene_.train);
    read_exposures(photometric_, scene_.train);
    read_fixed_points(options_, scene_);
    if (planned_) {
        const MaskLook masks = look_at_masks(scene_.train, scene_.points.positions);
        if (!pinned("loss.photometric.masks")) require_some_object(masks);
        apply(decide_masks(masks));
    }
    check_masks(photometric_, scene_.train);
    // Before stereo: masks of an object need coverage.
    check_consistency(options_.train, planned_);
    limit_to_object(photometric_.masks, scene_.train, scene_.points);
}

void Preparation::decide_settings(const ChosenViews& chosen) {
    SceneOptions& o = options_.scene;
    if (o.photo_memory == 0) o.photo_memory = memory_limits(options_.memory, device_.cuda).host / 4;
    if (o.photos == PhotoPlace::automatic) apply(decide_photographs(photo_storage(chosen, o)));
    with_context(str("reading scene ", o.path), [&] {
        const TrainOptions& train = options_.train;
        const Decision settings =
            tvsgs::decide_settings(int(chosen.split.train.size()), !train.tv.fixed_voters.empty());
        dense_ = settings.choice == kManyPhotographs;
        config_.table.read_text(kPlanSource, built_in_config(dense_ ? kDenseConfig : kSparseConfig),
                                /*below=*/true);
        apply(settings);
        if (pinned("tv.enabled") && !train.tv.enabled && !dense_) apply(drop_voting_losses());
        apply(drop_thickness_losses(train));
        check_consistency(train, true);
    });
}

// Round 2: the start points.

void Preparation::look() {
    look_ = look_at(scene_, options_.train.loss.multi_view, uses_masks(photometric_.masks), sky_);
    plan_.note(look_);
}

void Preparation::require_start() const {
    const std::string fault = start_fault(options_, scene_);
    if (fault.empty() || (options_.train.init.force && !scene_.points.positions.empty())) return;
    throw input_error("E_FEW_POINTS: ", options_.scene.path, ": ", fault,
                      "\n  Photograph each part from three or more places, 10 to 30 degrees apart, "
                      "sharp and well lit; surfaces need texture."
                      "\n  Or give points with --init-ply; --force trains from the few.");
}

void Preparation::decide_cloud() {
    if (!planned_) return;
    look();
    if (options_.scene.init_ply.empty()) apply(tvsgs::decide_cloud(look_, dense_));
}

void Preparation::provide_cloud() {
    stereo_ = prepare_points(device_, options_, scene_);
    sky_ = provide_sky(config_, scene_, planned_ ? &plan_ : nullptr);
    require_start();
    fit_near_plane(scene_, options_.train.render);
}

// Round 3: the training.

void Preparation::decide_training() {
    if (!planned_) return;
    if (scene_.points.positions.size() != look_.points || !sky_.views.empty()) look();
    if (const auto given = double(options_.plan.coverage); given >= 0) {
        apply(decide_coverage(look_.points_per_pixel, given));
        look_.points_per_pixel = given;
    }
    for (const Decision& decision : tvsgs::decide_training(look_, training_inputs()))
        apply(held_exposure(decision, options_));
    apply(decide_confirmed(look_));
    if (!pinned("mesh.depth_max") && !pinned("mesh.box")) {
        PointCloud meshed = scene_.points;
        const bool masked = options_.mesh.masks && look_.outside;
        if (masked) drop_background_points(scene_.train, meshed);
        const std::vector<Camera> cameras = detail::cameras_of(scene_.train);
        apply(decide_background(share_beyond(cameras, meshed.positions), masked));
        apply(decide_object(common_ball(cameras, meshed.positions)));
    }
    apply(drop_thickness_losses(options_.train));
    check_consistency(options_.train);
}

/// Fills gaps of a cloud that stereo has made.
void Preparation::provide_gap_points() {
    const int spacing_px = options_.train.init.gap_px;
    if (spacing_px == 0) return;
    if (!by_stereo())
        return spdlog::warn("init.gap_px fills no gaps, because stereo did not make the cloud");
    const std::size_t before = scene_.points.positions.size();
    stereo_.complete(scene_.train);
    add_gap_points(stereo_.maps, scene_.train, sky_, spacing_px, scene_.points);
    limit_to_object(photometric_.masks, scene_.train, scene_.points);
    spdlog::info("{} points fill gaps of the start cloud",
                 grouped(scene_.points.positions.size() - before));
}

/// Comes last: it counts the results of all other decisions.
void Preparation::decide_machines() {
    if (!planned_) return;
    apply(tvsgs::decide_machines(scene_, options_.train, machine_inputs()));
    // config.json has the decisions: a run that repeats it must not decide again.
    config_.table.set("plan.enabled", "false", kPlanSource);
}

TrainingInputs Preparation::training_inputs() const {
    TrainingInputs in;
    in.dense = dense_;
    in.discs = may_draw_discs(device_, config_);
    in.options = options_.train;
    in.configured = options_of(dense_ ? kDenseConfig : kSparseConfig).iterations;
    in.wanted = pinned("iterations") ? options_.train.iterations : -1;
    in.normals = !stereo_.maps.empty() && may_take_normals(config_);
    in.supported = by_stereo() && (options_.train.init.support || !pinned("init.support"));
    in.parts_colors =
        make_backbone<Cpu>(options_.train.backbone, options_.train.render)->traits.parts_colors;
    in.multi_view = options_of(kDenseConfig).loss;
    return in;
}

MachineInputs Preparation::machine_inputs() const {
    MachineInputs in;
    in.cuda = device_.cuda;
    in.limits = memory_limits(options_.memory, device_.cuda);
    in.first = std::int64_t(scene_.points.positions.size());
    in.expected =
        expected_splats(scene_, options_.train, in.first, pinned("densify.max_gaussians"));
    in.may_stream = !pinned("photo_bytes");
    in.may_compact = !pinned("tv.lists");
    return in;
}

void Preparation::provide_training(bool priors) {
    if (planned_ && priors) spdlog::debug("The plan:\n{}", plan_.text());
    read_fixed_splats(options_, scene_);  // as the rasteriser that was chosen draws them
    if (!priors) return;
    provide_soft_background(photometric_, scene_.train);
    provide_maps(device_, options_, std::move(stereo_), scene_);
}

void Preparation::provide_resumed(const ResumePoint& point) {
    read_fixed_splats(options_, scene_);
    stereo_ = {scene_.points.positions};
    restore_scene(point, scene_);
    read_sky(photometric_, point.run);
    provide_maps(device_, options_, std::move(stereo_), scene_);
}

}  // namespace

Resolved resolve(const DeviceChoice& device, const Configuration& asked, bool plan_only) {
    Preparation run(device, asked, asked.options.plan.enabled || plan_only);
    if (!asked.options.plan.enabled && plan_only)
        run.remark(
            "A run without --config would do this; the given configuration is not planned "
            "(plan.enabled).");
    run.read_views();
    run.decide_cloud();
    if (plan_only && run.needs_stereo()) {
        run.remark("Stereo makes the start points; the other decisions follow from them.");
        return run.result();
    }
    run.provide_cloud();
    run.decide_training();
    run.provide_gap_points();
    run.decide_machines();
    run.provide_training(!plan_only);
    return run.result();
}

Resolved resolve_resumed(const DeviceChoice& device,
                         const Configuration& asked,
                         const ResumePoint& point) {
    Preparation run(device, asked, false);
    run.read_views(true);
    run.provide_resumed(point);
    return run.result();
}

void check_consistency(const TrainOptions& options, bool before_plan) {
    const bool needs_votes =
        options.loss.tv_normal.weight > 0 || options.loss.tv_position.weight > 0;
    if (needs_votes && !options.tv.enabled)
        throw Error(
            ExitCode::usage,
            "configuration: tv.enabled is false but loss.tv_normal.weight or "
            "loss.tv_position.weight is above 0; set both weights to 0, or tv.enabled to true");
    const auto backbone = make_backbone<Cpu>(options.backbone, options.render);
    check_cameras(options, backbone->traits.has_camera_gradient);
    check_support(options, backbone->traits, before_plan);
    for (const TermOnList& term : terms_on_list(options.loss)) {
        if (!(term.weight > 0)) continue;
        const std::string lacks = names_of(without(term.needs.maps, backbone->traits.maps));
        if (term.needs.thickness && backbone->traits.flat)
            throw Error(ExitCode::usage, "loss.", term.key,
                        ".weight is above 0, but the splats of backbone '", options.backbone,
                        "' are flat; set the weight to 0, or choose another backbone");
        if (!lacks.empty())
            throw Error(ExitCode::usage, "loss.", term.key, ".weight is above 0, but backbone '",
                        options.backbone, "' does not make the maps it compares (", lacks,
                        "); set the weight to 0, or choose another backbone");
    }
}

void provide_maps(const DeviceChoice& device,
                  const RunOptions& options,
                  StereoStart stereo,
                  Scene& scene) {
    const MapNames wanted = needs_of(options.train.loss).view_maps;
    read_priors(options.priors, wanted, options.scene, scene);
    if (takes_stereo(options.priors))
        make_stereo_priors(device, stereo_options(options), wanted, std::move(stereo), scene.train);
    complete_maps(options.train.loss, scene.train);
}

}  // namespace tvsgs
