#include <algorithm>
#include <cmath>
#include <memory>

#include "apps/bench/cloud.h"
#include "apps/bench/iteration.h"
#include "apps/bench/subcommands.h"
#include "apps/common/key_flags.h"
#include "core/device/device_choice.h"
#include "core/device/parallel.h"
#include "core/device/threads.h"
#include "optim/growth/splat_order.h"
#include "pipeline/run/run_options.h"
#include "render/depth/map_images.h"
#include "render/tiles/blend_math.h"

namespace tvsgs {
namespace {

constexpr int kShDegree = 3;

/// Splats as one view sees them.
struct StageCase {
    enum class Kind { trained, in_view, one_tile, huge, needles, empty, one };

    std::string name;
    Kind kind;
    int splats, width, height;
    double size_px;        // median deviation of a splat in the image
    bool sorted = false;   // by place, as training keeps its splats; else in random order
    bool surface = false;  // on a smooth relief, flat along it, as several views have to agree on
};

/// w540, w1200: half of the splats in view, of some pixels, as on a trained surface, in random
/// order in memory; with _morton: in the order in which training keeps them; c256: a small one for
/// CPUs, all in view and as many over each pixel; and worst cases.
const std::vector<StageCase>& stage_cases() {
    using Kind = StageCase::Kind;
    static const std::vector<StageCase> cases = {
        {"w540", Kind::trained, 1'500'000, 960, 540, 2.5},
        {"w1200", Kind::trained, 1'500'000, 1600, 1200, 4.2},
        {"w540_morton", Kind::trained, 1'500'000, 960, 540, 2.5, true},
        {"w1200_morton", Kind::trained, 1'500'000, 1600, 1200, 4.2, true},
        {"c256", Kind::in_view, 20'000, 256, 256, 5.5},
        {"one_tile", Kind::one_tile, 1'500'000, 960, 540, 0.5},
        {"huge", Kind::huge, 2'000, 960, 540, 3000},
        {"needles", Kind::needles, 100'000, 960, 540, 2},
        {"empty", Kind::empty, 1'500'000, 960, 540, 2},
        {"one", Kind::one, 1, 960, 540, 2},
    };
    return cases;
}

/// Shortest times that an H200's memory, arithmetic and shuffles allow for w540 and w1200 at full
/// size, ms: without maps, and in PGSR's iteration with another view. 0: not counted.
struct Floor {
    const char* stage;
    double color[2], pair[2];
};
constexpr Floor kFloors[] = {
    {"all, one wait", {0.66, 1.06}, {0.94, 1.78}},
    // As project without colours, tile lists, blend.
    {"other views, forward", {}, {0.115, 0.212}},
    {"project", {0.130, 0.130}, {0.130, 0.130}},
    {"tile lists", {0.040, 0.054}, {0.040, 0.054}},
    {"blend", {0.045, 0.127}, {0.049, 0.139}},
    {"photometric loss", {0.014, 0.051}, {0.014, 0.051}},
    // As blend backward, then 132 bytes of geometry and its gradients per splat in view.
    {"other views, backward", {}, {0.140, 0.411}},
    // With the sums over each splat's fragments.
    {"blend backward", {0.117, 0.388}, {0.117, 0.388}},
    // With another view 44 bytes more per splat.
    {"project backward and Adam", {0.313, 0.313}, {0.328, 0.328}},
};

/// 0 where none is known.
double floor_ms(const std::string& stage, const std::string& name, Channels channels, bool pair) {
    const bool small = name.starts_with("w540");
    if ((has_plane(channels) && !pair) || (!small && !name.starts_with("w1200"))) return 0;
    for (const Floor& f : kFloors)
        if (stage == f.stage) return (pair ? f.pair : f.color)[small ? 0 : 1];
    return 0;
}

/// The relief at a ray's place (u, v) in an image plane at depth 1: its depth, and its normal,
/// which faces the camera.
constexpr float kReliefDepth = 4;
struct Relief {
    double depth;
    Vec3d normal;
};
Relief relief(double u, double v) {
    const double z = static_cast<double>(kReliefDepth) + 0.3 * std::sin(6 * u) * std::cos(6 * v);
    const double z_u = 1.8 * std::cos(6 * u) * std::cos(6 * v),
                 z_v = -1.8 * std::sin(6 * u) * std::sin(6 * v);
    const Vec3d along_u{z_u * u + z, z_u * v, z_u}, along_v{z_v * u, z_v * v + z, z_v};
    return {z, normalize(cross(along_v, along_u))};
}

double normal(Draws& draw) {
    const double radius = std::sqrt(-2 * std::log(draw.uniform(0, 1)));
    return radius * std::cos(draw.uniform(0, 6.283185307179586));
}

/// Moves a splat along its ray onto the relief, but for a part of its size, and lays it flat there,
/// but for a tilt of 0.1 rad. As large in the image: a splat turned at random shows half its area.
void put_on_relief(const StageCase& c, std::size_t i, Gaussians<Cpu>& g, Draws& draw) {
    const Vec3d mean = vec_cast<double>(g.means[i]);
    const double side = mean.z < 0 ? -1 : 1;  // what is behind the camera stays there
    const Relief at = relief(mean.x / mean.z, mean.y / mean.z);
    const double z = at.depth * (1 + 0.25 * c.size_px / c.width * normal(draw));
    g.means[i] = vec_cast<float>((side * z / mean.z) * mean);
    const double change = std::log(z / std::abs(mean.z) * std::sqrt(0.5));
    for (int k = 0; k < 3; ++k) g.log_scales[i][k] += static_cast<float>(change);
    const Vec3d n = normalize(at.normal + 0.1 * Vec3d{normal(draw), normal(draw), 0});
    const double turn = draw.uniform(0, 3.141592653589793);
    g.quats[i] = quat_cast<float>(turned_to(-n, turn));  // z away from the camera
}

/// At the origin, looking along z.
Camera stage_camera(const StageCase& c) {
    Camera camera;
    camera.width_px = c.width, camera.height_px = c.height;
    camera.fx_px = camera.fy_px = static_cast<float>(c.width);
    camera.cx_px = 0.5f * static_cast<float>(c.width);
    camera.cy_px = 0.5f * static_cast<float>(c.height);
    return camera;
}

/// Of a second view, 8 degrees around what the first one looks at.
Camera stage_other_view(const StageCase& c) {
    Camera camera = stage_camera(c);
    const float cosine = std::cos(0.14f), sine = std::sin(0.14f);
    camera.camera_from_world.R = {{{cosine, 0, sine}, {0, 1, 0}, {-sine, 0, cosine}}};
    const Vec3f centre{0, 0, kReliefDepth};  // stays where it is
    camera.camera_from_world.t = centre - camera.camera_from_world.R * centre;
    return camera;
}

/// A pure function of its argument; SH degree 3.
Gaussians<Cpu> make_stage_splats(const StageCase& c) {
    using Kind = StageCase::Kind;
    const double f = c.width;
    Gaussians<Cpu> g;
    resize(g, c.splats, kShDegree);
    fill_zero(g);
    parallel_for(Cpu{}, c.splats, [&](int splat) {
        const auto i = static_cast<std::size_t>(splat);
        Draws draw(1, splat);
        double x = draw.uniform(0, c.width), y = draw.uniform(0, c.height);
        double z = draw.uniform(2, 6);
        double opacity = 1 / (1 + std::exp(-normal(draw)));
        if (c.kind == Kind::one_tile) {
            x = c.width / 32 * 16 + draw.uniform(4, 12),
            y = c.height / 32 * 16 + draw.uniform(4, 12);
            opacity = draw.uniform(0.004, 0.01);
        }
        if (c.kind == Kind::huge) opacity = draw.uniform(0.006, 0.05);
        if (c.kind == Kind::one) x = 0.5 * c.width, y = 0.5 * c.height;
        const bool behind = c.kind == Kind::empty || (c.kind == Kind::trained && splat % 2 == 1);
        if (behind) z = -z;
        g.means[i] = {static_cast<float>((x - 0.5 * c.width) / f * z),
                      static_cast<float>((y - 0.5 * c.height) / f * z), static_cast<float>(z)};
        const double scale = std::log(c.size_px / f * std::abs(z));
        const double a = scale + 0.4 * normal(draw), b = scale + 0.4 * normal(draw);
        g.log_scales[i] = {static_cast<float>(a), static_cast<float>(b),
                           static_cast<float>(std::min(a, b) - (c.kind == Kind::huge ? 0 : 3))};
        if (c.kind == Kind::needles) g.log_scales[i].x = static_cast<float>(scale + std::log(50.0));
        g.quats[i] = {static_cast<float>(normal(draw)), static_cast<float>(normal(draw)),
                      static_cast<float>(normal(draw)), static_cast<float>(normal(draw))};
        g.opacity_logits[i] = static_cast<float>(std::log(opacity / (1 - opacity)));
        for (std::size_t k = 0; k < static_cast<std::size_t>(sh_count(kShDegree)); ++k) {
            const double spread = k == 0 ? 0.8 : 0.1;
            g.sh[k * static_cast<std::size_t>(c.splats) + i] = {
                static_cast<float>(draw.uniform(-spread, spread)),
                static_cast<float>(draw.uniform(-spread, spread)),
                static_cast<float>(draw.uniform(-spread, spread))};
        }
        if (c.surface) put_on_relief(c, i, g, draw);
    });
    if (c.sorted) sort_by_place(g);
    return g;
}

/// The iteration with the losses of `options`, on photographs that show the splats.
template <class Device>
IterationTimes measure(const StageCase& c,
                       const TrainOptions& options,
                       int warm_up,
                       int repetitions) {
    const std::int64_t before = memory_use(Device{}).current_bytes;
    const Gaussians<Cpu> splats = make_stage_splats(c);
    Scene scene;
    scene.points.positions.assign(splats.means.data(), splats.means.data() + splats.size());
    {
        Gaussians<Device> shown;
        copy(splats, shown);
        const auto backbone = make_backbone<Device>(options.backbone, options.render);
        for (const Camera& camera : {stage_camera(c), stage_other_view(c)}) {
            const auto& images = backbone->forward(shown, camera, kShDegree, Maps::color);
            scene.train.push_back({std::to_string(scene.train.size()),
                                   camera,
                                   color_image(c.width, c.height, to_host(images.color)),
                                   {},
                                   {}});
        }
    }
    IterationTimes out = time_iteration<Device>(scene, options, splats, warm_up, repetitions);
    out.bytes -= before;
    return out;
}

constexpr const char* kChannelNames[] = {"color", "color_plane", "plane"};

struct StagesArguments {
    std::vector<std::string> cases;
    std::string device = "auto", out;
    int repetitions = 50, warm_up = 20;
    double scale = 1, splats_scale = 1, pixels_scale = 1;
    Configuration configuration;
    KeyFlags flags;

    explicit StagesArguments(CLI::App& app) : flags(app, configuration.table) {}
    /// Of a training whose iteration can be timed alone; without a configuration that of 3DGS.
    const TrainOptions& training() {
        TrainOptions& o = configuration.options.train;
        if (!flags.has_files()) o.tv.enabled = false;
        flags.set_all(configuration.table);
        if (o.tv.enabled || o.loss.tv_normal.weight > 0 || o.loss.tv_position.weight > 0)
            throw usage_error(
                "--config: tensor voting is on; turn it off (tv.enabled=false, "
                "loss.tv_normal.weight=0, loss.tv_position.weight=0), or use tvsgs-bench vote");
        if (o.iterations < 1)
            throw usage_error("--config: iterations is ", o.iterations, "; expected 1 or more");
        return o;
    }
};

/// The case with its size changed by the flags.
StageCase scaled(StageCase c, const StagesArguments& a) {
    const double splats = a.scale * a.splats_scale, pixels = a.scale * a.pixels_scale;
    if (c.kind != StageCase::Kind::one) c.splats = std::max(1, static_cast<int>(splats * c.splats));
    c.width = std::max(16, static_cast<int>(std::sqrt(pixels) * c.width));
    c.height = std::max(16, static_cast<int>(std::sqrt(pixels) * c.height));
    c.size_px *= std::sqrt(pixels / splats);
    c.surface = a.flags.has_files();
    return c;
}

int time_cases(StagesArguments& a) {
    const DeviceChoice device = choose_device(a.device);
    const TrainOptions& options = a.training();
    const bool full_size = a.scale * a.splats_scale == 1 && a.scale * a.pixels_scale == 1;
    std::string lines;
    for (const StageCase& known : stage_cases()) {
        if (!a.cases.empty() && std::ranges::find(a.cases, known.name) == a.cases.end()) continue;
        const StageCase c = scaled(known, a);
        const IterationTimes m = on_device(device, [&](auto tag) {
            return measure<decltype(tag)>(c, options, a.warm_up, a.repetitions);
        });
        Timings timings;
        for (const double ms : m.all_ms) timings.add("all, one wait", ms);
        for (const auto& laps : m.laps)
            for (const auto& [stage, ms] : laps) timings.add(stage, ms);
        const Channels channels = channels_of(m.maps);
        const double unaccounted = percentile(m.unaccounted, 50);
        const JsonValue stages = timings.json([&](const std::string& stage) {
            return full_size && device.cuda
                       ? floor_ms(stage, c.name, channels, m.compared_pixels > 0)
                       : 0;
        });
        const auto per_pixel = [&c](std::int64_t count) {
            return static_cast<double>(count) / (static_cast<double>(c.width) * c.height);
        };
        JsonValue losses = JsonValue::list(), counters, json;
        for (const auto& [name, value] : m.losses)
            losses.items.push_back(JsonValue().add("loss", name).add("value", value));
        counters.add("splats", c.splats)
            .add("visible", m.counts.visible)
            .add("fragments", m.counts.fragments)
            .add("warp_tests", m.work.tests)
            .add("warp_hits", m.work.hits)
            .add("warp_draws", m.work.draws)
            .add("warp_sums", m.work.sums)
            .add("evaluations_per_pixel", per_pixel(m.work.evaluations))
            .add("contributions_per_pixel", per_pixel(m.work.contributions))
            .add("compared_pixels", m.compared_pixels)
            .add("bytes_held", m.bytes);
        const char* const maps = kChannelNames[static_cast<int>(channels)];
        json.add("bench", "stages")
            .add("version", kVersion)
            .add("device", device.description)
            .add("threads", thread_count())
            .add("case", c.name)
            .add("width", c.width)
            .add("height", c.height)
            .add("channels", maps)
            .add("counters", counters)
            .add("losses", losses)
            .add("stages", stages)
            .add("unaccounted_share", unaccounted);
        lines += json_text(json) + "\n";
        if (is_quiet()) continue;
        std::fprintf(stderr, "%s, %d x %d, %s, %s\n", c.name.c_str(), c.width, c.height, maps,
                     device.description.c_str());
        timings.print();
        std::fprintf(stderr, "  in no stage, with all waits: %.1f %%\n", 100 * unaccounted);
        std::fprintf(stderr, "  losses %s\n  counters %s\n", json_text(losses).c_str(),
                     json_text(counters).c_str());
    }
    put_lines(lines, a.out);
    return 0;
}

}  // namespace

Subcommand add_bench_stages(CLI::App& app) {
    CLI::App& c = *app.add_subcommand("stages", "time the stages of a training iteration");
    const auto a = std::make_shared<StagesArguments>(c);
    std::vector<std::string> names;
    for (const StageCase& known : stage_cases()) names.push_back(known.name);
    add_repeated(c, "--case", a->cases, "a synthetic view [all]")->check(CLI::IsMember(names));
    add_number(c, "--scale", a->scale, 1e-6, 4.0,
               "factor on splats and pixels of each case; lower bounds are shown at 1 only");
    add_number(c, "--splats-scale", a->splats_scale, 1e-6, 100.0,
               "factor on the number of splats, which get smaller: same count per pixel");
    add_number(c, "--pixels-scale", a->pixels_scale, 1e-6, 100.0,
               "factor on the number of pixels, splats get larger: same count per pixel");
    a->flags.add_config(
        "JSON file of a training; times its last iteration with all losses, on a surface that two "
        "views see; later files win [the photometric loss alone, splats anywhere]");
    add_number(c, "--repetitions", a->repetitions, 1, 100'000, "timed repetitions");
    add_number(c, "--warm-up", a->warm_up, 1, 100'000, "repetitions before the timed ones");
    c.add_option("--device", a->device, "auto, cpu, cuda or cuda:N");
    add_output_flag(c, "--out", a->out, "JSON file for the results, too");
    return {&c, [a] { return time_cases(*a); }};
}

}  // namespace tvsgs
