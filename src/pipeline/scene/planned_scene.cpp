#include "pipeline/scene/planned_scene.h"

#include <cmath>

#include "core/device/device_choice.h"
#include "io/config/built_in_configs.h"
#include "pipeline/priors/view_maps.h"
#include "pipeline/scene/exposures.h"
#include "pipeline/scene/initial_points.h"
#include "pipeline/scene/sky.h"
#include "plan/background.h"
#include "plan/machines.h"

namespace tvsgs {
namespace {

/// A built-in configuration alone.
TrainOptions options_of(const char* config) {
    RunOptions options;
    OptionTable table;
    options.add_to(table);
    table.read_text("the program", built_in_config(config));
    return options.train;
}

/// Leaves out what makes splats thin where the rasteriser has no use for it.
void plan_thickness(const TrainOptions& options, RunPlan& plan) {
    const auto backbone = make_backbone<Cpu>(options.backbone, options.render);
    const char* const why = backbone->traits.flat ? "the splats are flat"
                            : backbone->traits.fades_thin_splats
                                ? "the rasteriser fades thin splats"
                                : nullptr;
    for (const TermOnList& term : terms_on_list(options.loss))
        if (why != nullptr && term.needs.thickness && term.weight > 0)
            plan.apply({str(term.key, " loss"),
                        "off",
                        why,
                        NAN,
                        NAN,
                        {{str("loss.", term.key, ".weight"), "0"}}});
}

/// Not on a CPU, where their iterations take several times as long, nor where the user asks for a
/// rasteriser, or for what discs do not have.
bool may_draw_discs(const DeviceChoice& device, const TrainOptions& options, const RunPlan& plan) {
    if (!device.cuda || plan.pinned("backbone")) return false;
    for (const TermOnList& term : terms_on_list(options.loss))
        if (term.needs.thickness && term.weight > 0 &&
            plan.pinned(str("loss.", term.key, ".weight")))
            return false;
    try {
        make_backbone<Cpu>(kDiscs, options.render);
        return true;
    } catch (const Error&) {  // of an option that it does not go by
        return false;
    }
}

bool takes_stereo(const PriorOptions& priors) {
    return priors.source == PriorOptions::Source::automatic ||
           priors.source == PriorOptions::Source::stereo;
}

/// Not where the user has priors in mind: files, or terms that want maps.
bool may_take_normals(const RunOptions& options, const RunPlan& plan) {
    if (!takes_stereo(options.priors) || !options.priors.dir.empty() ||
        plan.pinned("loss.prior_normal.weight"))
        return false;
    for (const TermOnList& term : terms_on_list(options.train.loss))
        for (const std::string_view map : term.needs.view_maps)
            if (term.weight > 0 && map != "mask") return false;
    return true;
}

/// The decision, but where another run has fitted the exposures.
Decision held_exposure(const Decision& decision, const RunOptions& options) {
    const std::string& run = options.train.loss.photometric.exposure_from;
    if (run.empty()) return decision;
    return {"exposure", "held", str("as ", run, " has fitted it"), NAN, NAN, {}};
}

/// Last, as every other decision says what is held.
void plan_machine(const DeviceChoice& device,
                  const RunOptions& options,
                  const Scene& scene,
                  RunPlan& plan) {
    MachineInputs in;
    in.cuda = device.cuda;
    in.limits = memory_limits(options.memory, device.cuda);
    in.first = static_cast<std::int64_t>(scene.points.positions.size());
    in.expected =
        expected_splats(scene, options.train, in.first, plan.pinned("densify.max_gaussians"));
    in.may_stream = !plan.pinned("photo_bytes");
    in.may_compact = !plan.pinned("tv.lists");
    plan.apply(plan_machines(scene, options.train, in));
}

/// Chooses the settings to start from; returns whether they are the dense ones.
bool plan_start(int train_views, RunOptions& options, RunPlan& plan) {
    const Decision settings = plan_settings(train_views, !options.train.tv.fixed_voters.empty());
    const bool dense = settings.choice == "dense";
    plan.apply(settings, built_in_config(dense ? kDenseConfig : kSparseConfig));
    if (plan.pinned("tv.enabled") && !options.train.tv.enabled && !dense)
        plan.apply({"voting losses",
                    "off",
                    "as voting is",
                    NAN,
                    NAN,
                    {{"loss.tv_normal.weight", "0"}, {"loss.tv_position.weight", "0"}}});
    plan_thickness(options.train, plan);
    check_consistency(options.train);
    return dense;
}

}  // namespace

void check_consistency(const TrainOptions& options) {
    const bool needs_votes =
        options.loss.tv_normal.weight > 0 || options.loss.tv_position.weight > 0;
    if (needs_votes && !options.tv.enabled)
        throw Error(ExitCode::usage,
                    "configuration: tv.enabled is false but loss.tv_normal.weight or "
                    "loss.tv_position.weight is above 0; "
                    "set both weights to 0, or tv.enabled to true");
    const auto backbone = make_backbone<Cpu>(options.backbone, options.render);
    check_cameras(options, backbone->traits.moves_cameras);
    for (const TermOnList& term : terms_on_list(options.loss)) {
        if (!(term.weight > 0)) continue;
        const std::string lacks = names_of(without(term.needs.maps, backbone->traits.maps));
        if (term.needs.thickness && backbone->traits.flat)
            throw Error(ExitCode::usage,
                        str("loss.", term.key, ".weight is above 0, but the splats of backbone '",
                            options.backbone,
                            "' are flat; set the weight to 0, or choose another "
                            "backbone"));
        if (!lacks.empty())
            throw Error(ExitCode::usage,
                        str("loss.", term.key, ".weight is above 0, but backbone '",
                            options.backbone, "' does not make the maps it compares (", lacks,
                            "); set the weight to 0, or choose another backbone"));
    }
}

namespace {

/// read_views() of views that are chosen. The view that is held out brings no points, so a run
/// that goes on, which knows it from the start, reads the same ones.
Scene load_and_hold_out(ChosenViews chosen, RunOptions& options, bool resumed, OptionTable& table) {
    std::vector<int>& train = chosen.split.train;
    const auto load = [&] {
        Scene scene = load_scene(chosen, options.scene);
        read_exposures(options.train.loss.photometric, scene.train);
        return scene;
    };
    if (options.plan.until != Until::converged || !chosen.split.test.empty()) return load();
    constexpr std::size_t kFew = 6;
    if (resumed || train.size() < kFew)
        throw Error(ExitCode::usage,
                    str("--until converged: ", train.size(), " training views",
                        resumed ? ", of which the run has seen all," : "",
                        " and no test views; expected test views (--eval, --split or --test-list), "
                        "or in a new run ",
                        kFew, " training views, of which one is held out"));
    const auto middle = train.begin() + static_cast<std::ptrdiff_t>(train.size() / 2);
    const std::string& name = chosen.layout.model.images[static_cast<std::size_t>(*middle)].name;
    spdlog::info("--until converged: {} is held out", name);
    table.set("scene.held_out", name, "--until converged");
    chosen.split.test.push_back(*middle);
    train.erase(middle);
    return load();
}

}  // namespace

Scene read_views(RunOptions& options, bool resumed, OptionTable& table) {
    Scene scene = load_and_hold_out(choose_views(options.scene), options, resumed, table);
    check_masks(options.train.loss.photometric, scene.train);
    keep_to_object(options.train.loss.photometric.masks, scene.train, scene.points);
    return scene;
}

void provide_maps(const DeviceChoice& device,
                  const RunOptions& options,
                  StereoStart stereo,
                  Scene& scene) {
    const MapNames wanted = needs_of(options.train.loss).view_maps;
    read_priors(options.priors, wanted, options.scene, scene);
    if (takes_stereo(options.priors))
        make_stereo_priors(device, stereo_options(options), wanted, std::move(stereo), scene.train);
    complete_maps(options.train.loss, options.descriptors, scene.train);
}

Scene read_and_plan(const DeviceChoice& device,
                    bool plan_only,
                    RunOptions& options,
                    OptionTable& table,
                    RunPlan& plan) {
    if (!options.plan.enabled && !plan_only) {
        options.scene.points_required = options.train.init.min_points == 0;
        Scene scene = read_views(options, false, table);
        read_fixed_points(options, scene);
        read_fixed_splats(options, scene);
        StereoStart found = prepare_points(device, options, scene);
        provide_sky(options, scene, nullptr);
        fit_near_plane(scene, options.train.render);
        provide_maps(device, options, std::move(found), scene);
        return scene;
    }
    options.scene.points_required = false;
    const ChosenViews chosen = choose_views(options.scene);
    if (options.scene.photo_memory == 0)
        options.scene.photo_memory = memory_limits(options.memory, device.cuda).host / 4;
    if (const PhotoStorage photos = photo_storage(chosen, options.scene);
        photos.in_file && options.scene.photos == PhotoPlace::automatic)
        plan.apply({"photographs",
                    "in a file",
                    photos.reason(),
                    static_cast<double>(photos.bytes) / 1e9,
                    static_cast<double>(photos.limit) / 1e9,
                    {{"scene.photos", "file"}}});
    const bool dense = with_context(str("reading scene ", options.scene.path), [&] {
        return plan_start(static_cast<int>(chosen.split.train.size()), options, plan);
    });
    Scene scene = load_and_hold_out(chosen, options, false, table);
    read_fixed_points(options, scene);

    for (const Decision& decision : plan_masks(look_at_masks(scene.train, scene.points.positions)))
        plan.apply(decision);
    const MaskUse use = options.train.loss.photometric.masks;
    const bool masks = uses_masks(use);
    check_masks(options.train.loss.photometric, scene.train);
    check_consistency(options.train);  // before stereo: masks of an object need coverage
    keep_to_object(use, scene.train, scene.points);
    SkyLook sky;
    const auto look = [&] {
        const SceneLook seen = look_at(scene, options.train.loss.multi_view, masks, sky);
        plan.note(seen);
        return seen;
    };
    SceneLook seen = look();
    if (options.scene.init_ply.empty()) plan.apply(plan_cloud(seen, dense));
    const bool stereo = needs_stereo(options, scene);
    if (!options.plan.enabled)
        plan.remark(
            "This is what a run without --config would do; the configuration given is not "
            "planned (plan.enabled).");
    if (plan_only && stereo) {
        plan.remark("More is decided on the cloud that stereo makes.");
        return scene;
    }
    StereoStart found = prepare_points(device, options, scene);
    sky = provide_sky(options, scene, &plan);
    if (scene.points.positions.empty())
        throw Error(ExitCode::input, str("E_NO_POINTS: ", options.scene.path,
                                         ": no initial points; pass --init-ply, or let stereo make "
                                         "a cloud (init.min_points)"));
    fit_near_plane(scene, options.train.render);
    if (scene.points.positions.size() != seen.points || !sky.views.empty()) seen = look();
    if (const auto given = static_cast<double>(options.plan.coverage); given >= 0) {
        plan.apply(given_coverage(seen.points_per_pixel, given));
        seen.points_per_pixel = given;
    }
    const TrainOptions multi_view = options_of(kDenseConfig);
    const int configured = options_of(dense ? kDenseConfig : kSparseConfig).iterations,
              wanted = plan.pinned("iterations") ? options.train.iterations : -1;
    const bool discs = may_draw_discs(device, options.train, plan),
               normals = !found.maps.empty() && may_take_normals(options, plan);
    for (const Decision& decision : plan_training(
             seen, {dense, discs, options.train, configured, wanted, normals, multi_view.loss}))
        plan.apply(decision.name == "exposure" ? held_exposure(decision, options) : decision);
    if (!plan.pinned("mesh.depth_max") && !plan.pinned("mesh.box")) {
        PointCloud meshed = scene.points;
        const bool masked = options.mesh.masks && seen.outside;
        if (masked) drop_background_points(scene.train, meshed);
        plan.apply(plan_background(share_beyond(detail::cameras_of(scene.train), meshed.positions),
                                   masked));
    }
    plan_thickness(options.train, plan);
    check_consistency(options.train);
    plan_machine(device, options, scene, plan);
    if (!plan_only) spdlog::info("the plan (--plan prints it alone):\n{}", plan.text());
    read_fixed_splats(options, scene);  // as the rasteriser that was chosen draws them
    if (!plan_only) provide_maps(device, options, std::move(found), scene);
    plan.finish();
    return scene;
}

}  // namespace tvsgs
