#include "apps/bench/stages.h"

#include <cmath>

#include "apps/bench/iteration.h"
#include "apps/bench/stats.h"
#include "core/device/device_choice.h"
#include "core/device/parallel.h"
#include "core/math/rng.h"
#include "io/files/atomic_file.h"
#include "optim/growth/splat_order.h"
#include "optim/optimiser/adam.h"
#include "pipeline/run/run_options.h"
#include "render/depth/map_images.h"
#include "render/photometric/photometric.h"
#include "render/tiles/channels.h"

namespace tvsgs {
namespace {

constexpr int kShDegree = 3;

/// Shortest times that an H200's memory, arithmetic and shuffles allow for w540 and w1200 at full
/// size, ms, with channels color; with color_plane; in PGSR's iteration with another view. 0: not
/// counted.
struct Floor {
    const char* stage;
    double color[2], plane[2], pair[2];
};
constexpr Floor kFloors[] = {
    {"all, one wait", {0.66, 1.06}, {}, {0.94, 1.78}},
    {"other views, forward",
     {},
     {},
     {0.115, 0.212}},  // as project without colours, tile lists, blend
    {"project", {0.130, 0.130}, {0.130, 0.130}, {0.130, 0.130}},
    {"tile lists", {0.040, 0.054}, {0.040, 0.054}, {0.040, 0.054}},
    {"blend", {0.045, 0.127}, {0.049, 0.139}, {0.049, 0.139}},
    {"photometric loss", {0.014, 0.051}, {0.014, 0.051}, {0.014, 0.051}},
    // As blend backward, then 132 bytes of geometry and its gradients per splat in view.
    {"other views, backward", {}, {}, {0.140, 0.411}},
    // With the sums over each splat's fragments.
    {"blend backward", {0.117, 0.388}, {0.117, 0.388}, {0.117, 0.388}},
    // With another view 44 bytes more per splat.
    {"project backward and Adam", {0.313, 0.313}, {0.313, 0.313}, {0.328, 0.328}},
};

/// 0 where none is known.
double floor_ms(const std::string& stage, const std::string& name, Channels channels, bool pair) {
    if (channels == Channels::plane || (!name.starts_with("w540") && !name.starts_with("w1200")))
        return 0;
    for (const Floor& f : kFloors)
        if (stage == f.stage)
            return (pair                  ? f.pair
                    : has_plane(channels) ? f.plane
                                          : f.color)[name.starts_with("w540") ? 0 : 1];
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

/// Uniform and normal numbers of one splat.
class Draws {
public:
    explicit Draws(std::size_t splat) : splat_(splat) {}
    double uniform(double low, double high) {
        return low + (high - low) * static_cast<double>(tvsgs::uniform(bits()));
    }
    double normal() {
        const double radius = std::sqrt(-2 * std::log(uniform(0, 1)));
        return radius * std::cos(uniform(0, 6.283185307179586));
    }

private:
    std::uint32_t bits() {
        if (used_ % 4 == 0) four_ = random4(1, RandomStream::test, splat_, used_ / 4);
        return four_.v[used_++ % 4];
    }
    std::size_t splat_;
    std::uint32_t used_ = 0;
    Random4 four_{};
};

/// Moves a splat along its ray onto the relief, but for a part of its size, and lays it flat there,
/// but for a tilt of 0.1 rad. As large in the image: a splat turned at random shows half its area.
void put_on_relief(const StageCase& c, std::size_t i, Gaussians<Cpu>& g, Draws& draw) {
    const Vec3d mean = vec_cast<double>(g.means[i]);
    const double side = mean.z < 0 ? -1 : 1;  // what is behind the camera stays there
    const Relief at = relief(mean.x / mean.z, mean.y / mean.z);
    const double z = at.depth * (1 + 0.25 * c.size_px / c.width * draw.normal());
    g.means[i] = vec_cast<float>((side * z / mean.z) * mean);
    const double change = std::log(z / std::abs(mean.z) * std::sqrt(0.5));
    for (int k = 0; k < 3; ++k) g.log_scales[i][k] += static_cast<float>(change);
    const Vec3d n = normalize(at.normal + 0.1 * Vec3d{draw.normal(), draw.normal(), 0});
    // A turn about z, then the shortest rotation that takes -z to the normal.
    const double turn = draw.uniform(0, 3.141592653589793), w = std::cos(turn), s = std::sin(turn);
    const Quat<double> q = normalize(Quat<double>{1 - n.z, n.y, -n.x, 0});
    g.quats[i] =
        quat_cast<float>(Quat<double>{q.w * w, q.x * w + q.y * s, q.y * w - q.x * s, q.w * s});
}

struct Measured {
    Timings timings;
    double unaccounted;  // median share of an iteration that is in no stage, with all waits
    RenderCounts counts;
    BlendWork work;
    std::int64_t bytes;
    std::vector<std::pair<std::string, double>> losses{};  // of a configuration's
    int compared_pixels = 0;                               // with the other view
    Channels channels{};
};

/// One view again and again: first as in training, with one wait at the end, then with a wait
/// around every stage.
template <class Device, class Iteration>
Measured time_stages(const Iteration& iteration,
                     Backbone<Device>& backbone,
                     int warm_up,
                     int repetitions) {
    Measured out{};
    StageClock<Device> off;
    for (int i = 0; i < warm_up; ++i) iteration(off);
    for (int i = 0; i < repetitions; ++i) {
        synchronize(Device{});
        const Stopwatch watch;
        iteration(off);
        synchronize(Device{});
        out.timings.add("all, one wait", watch.ms());
    }
    backbone.clock() = StageClock<Device>(true);
    std::vector<double> unaccounted;
    for (int i = 0; i < repetitions; ++i) {
        StageClock<Device> own(true);
        backbone.clock().clear();
        synchronize(Device{});
        const Stopwatch watch;
        iteration(own);
        synchronize(Device{});
        const double all = watch.ms();
        double left = all;
        for (const auto* clock : {&own, &backbone.clock()})
            for (const StageTime& stage : clock->stages()) {
                out.timings.add(stage.name, 1e3 * stage.seconds);
                left -= 1e3 * stage.seconds;
            }
        unaccounted.push_back(left / all);
    }
    out.unaccounted = percentile(unaccounted, 50);
    out.counts = backbone.counts();
    out.work = backbone.blend_work();
    return out;
}

/// The iteration of the losses of a configuration, on photographs that show the splats.
template <class Device>
Measured measure_training(const StageCase& c,
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
    BenchIteration<Device> iteration(scene, options, splats);
    Measured out = time_stages<Device>([&](StageClock<Device>& clock) { iteration.run(clock); },
                                       iteration.backbone(), warm_up, repetitions);
    out.losses = iteration.losses();
    out.compared_pixels = iteration.compared_pixels();
    out.channels = channels_of(iteration.maps());
    out.bytes = memory_use(Device{}).current_bytes - before;
    return out;
}

Maps maps_of(Channels channels) {
    return (has_color(channels) ? Maps::color : Maps::none) |
           (has_plane(channels) ? kGeometryMaps : Maps::none);
}

/// The iteration with the photometric loss, or with given derivatives of normal and depth.
template <class Device>
Measured measure(const StageCase& c, Channels channels, int warm_up, int repetitions) {
    const Camera camera = stage_camera(c);
    const std::int64_t before = memory_use(Device{}).current_bytes;
    Gaussians<Device> splats, no_more;
    copy(make_stage_splats(c), splats);
    const auto pixels = static_cast<std::size_t>(c.width) * static_cast<std::size_t>(c.height);
    std::vector<std::uint8_t> noise(3 * pixels);
    for (std::size_t i = 0; i < noise.size(); ++i)
        noise[i] = static_cast<std::uint8_t>(random4(2, RandomStream::test, i).v[0]);
    const auto photo = to_device<Device>(noise);
    PhotometricScratch<Device> scratch;
    Buffer<float, Device> pixel_loss(pixels);
    ImageGradients<Device> dL_dimages;
    if (has_color(channels)) dL_dimages.color.resize(pixels);
    if (has_plane(channels)) {
        const float share = 1.0f / static_cast<float>(pixels);
        copy(std::vector<Vec3f>(pixels, {share, share, -share}), dL_dimages.normal);
        copy(std::vector<float>(pixels, share), dL_dimages.depth);
    }
    const auto backbone = make_backbone<Device>(TrainOptions{}.backbone, {});
    // At rate 0 Adam works as ever, but the view stays the same.
    Adam<Device> adam({0, 0, 1, 0, 0, 0, 0, 0}, splats);

    const auto iteration = [&](StageClock<Device>& clock) {
        const auto& images = backbone->forward(splats, camera, kShDegree, maps_of(channels));
        if (has_color(channels))
            clock("photometric loss", [&] {
                dL_dimages.color.fill_zero();
                photometric_loss({images.color.span(),
                                  photo.span(),
                                  c.width,
                                  c.height,
                                  {0.8f, 0.2f},
                                  dL_dimages.color.span(),
                                  pixel_loss.span()},
                                 scratch);
            });
        const FusedGradients& gradients = *backbone->blend_backward(splats, dL_dimages);
        clock("project backward and Adam",
              [&] { adam.step(1, 1, kShDegree, gradients, no_more, splats, true); });
    };
    Measured out = time_stages<Device>(iteration, *backbone, warm_up, repetitions);
    out.channels = channels;
    out.bytes = memory_use(Device{}).current_bytes - before;
    return out;
}

constexpr const char* kChannelNames[] = {"color", "color_plane", "plane"};

/// Of a training whose iteration can be timed alone.
TrainOptions read_configuration(const std::vector<std::string>& files,
                                const std::vector<std::string>& settings) {
    RunOptions options;
    OptionTable table;
    options.add_to(table);
    for (const std::string& file : files) table.read_file(file);
    table.set_all(settings);
    const TrainOptions& o = options.train;
    if (o.tv.enabled || o.loss.tv_normal.weight > 0 || o.loss.tv_position.weight > 0)
        throw Error(ExitCode::usage,
                    "--config: tensor voting is on; turn it off (tv.enabled=false, "
                    "loss.tv_normal.weight=0, loss.tv_position.weight=0), or use tvsgs-bench vote");
    if (o.iterations < 1)
        throw Error(ExitCode::usage,
                    str("--config: iterations is ", o.iterations, "; expected 1 or more"));
    return o;
}

}  // namespace

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

Camera stage_camera(const StageCase& c) {
    Camera camera;
    camera.width_px = c.width, camera.height_px = c.height;
    camera.fx_px = camera.fy_px = static_cast<float>(c.width);
    camera.cx_px = 0.5f * static_cast<float>(c.width);
    camera.cy_px = 0.5f * static_cast<float>(c.height);
    return camera;  // at the origin, looking along z
}

Camera stage_other_view(const StageCase& c) {
    Camera camera = stage_camera(c);
    const float cosine = std::cos(0.14f), sine = std::sin(0.14f);
    camera.camera_from_world.R = {{{cosine, 0, sine}, {0, 1, 0}, {-sine, 0, cosine}}};
    const Vec3f centre{0, 0, kReliefDepth};  // stays where it is
    camera.camera_from_world.t = centre - camera.camera_from_world.R * centre;
    return camera;
}

Gaussians<Cpu> make_stage_splats(const StageCase& c) {
    using Kind = StageCase::Kind;
    const double f = c.width;
    Gaussians<Cpu> g;
    resize(g, c.splats, kShDegree);
    fill_zero(g);
    parallel_for(Cpu{}, c.splats, [&](int splat) {
        const auto i = static_cast<std::size_t>(splat);
        Draws draw(i);
        double x = draw.uniform(0, c.width), y = draw.uniform(0, c.height);
        double z = draw.uniform(2, 6);
        double opacity = 1 / (1 + std::exp(-draw.normal()));
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
        const double a = scale + 0.4 * draw.normal(), b = scale + 0.4 * draw.normal();
        g.log_scales[i] = {static_cast<float>(a), static_cast<float>(b),
                           static_cast<float>(std::min(a, b) - (c.kind == Kind::huge ? 0 : 3))};
        if (c.kind == Kind::needles) g.log_scales[i].x = static_cast<float>(scale + std::log(50.0));
        g.quats[i] = {static_cast<float>(draw.normal()), static_cast<float>(draw.normal()),
                      static_cast<float>(draw.normal()), static_cast<float>(draw.normal())};
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

StagesBench::StagesBench(CLI::App& app)
    : command_(app.add_subcommand("stages", "time the stages of a training iteration")) {
    CLI::App& c = *command_;
    std::vector<std::string> names;
    for (const StageCase& known : stage_cases()) names.push_back(known.name);
    c.add_option("--case", cases_, "a synthetic view [all]")
        ->expected(1)
        ->take_all()
        ->check(CLI::IsMember(names));
    c.add_option("--scale", scale_,
                 "factor on splats and pixels of each case; lower bounds are shown at 1 only")
        ->check(in_range(1e-6, 4.0))
        ->capture_default_str();
    c.add_option("--splats-scale", splats_scale_,
                 "factor on the number of splats, which get smaller: same count per pixel")
        ->check(in_range(1e-6, 100.0))
        ->capture_default_str();
    c.add_option("--pixels-scale", pixels_scale_,
                 "factor on the number of pixels, splats get larger: same count per pixel")
        ->check(in_range(1e-6, 100.0))
        ->capture_default_str();
    CLI::Option* const channels = c.add_option("--channels", channels_, "maps to render")
                                      ->check(CLI::IsMember({"color", "color_plane", "plane"}))
                                      ->capture_default_str();
    CLI::Option* const config =
        c.add_option("-c,--config", configs_,
                     "JSON file of a training; times its last iteration with all losses, on a "
                     "surface that two views see; later files win")
            ->expected(1)
            ->take_all()
            ->excludes(channels);
    c.add_option("--set", settings_, "any key of the configuration")
        ->expected(1)
        ->take_all()
        ->needs(config);
    c.add_option("--repetitions", repetitions_, "timed repetitions")
        ->check(CLI::Range(1, 100'000))
        ->capture_default_str();
    c.add_option("--warm-up", warm_up_, "repetitions before the timed ones")
        ->check(CLI::Range(1, 100'000))
        ->capture_default_str();
    c.add_option("--device", device_, "auto, cpu, cuda or cuda:N")->capture_default_str();
    add_output_flag(c, "--out", out_, "JSON file for the results, too");
    c.add_flag("--quiet", quiet_, "warnings and errors only");
}

int StagesBench::run() const {
    const DeviceChoice device = choose_device(device_);
    const Channels channels = channels_ == "color"         ? Channels::color
                              : channels_ == "color_plane" ? Channels::color_plane
                                                           : Channels::plane;
    const bool training = !configs_.empty();
    const TrainOptions options =
        training ? read_configuration(configs_, settings_) : TrainOptions{};
    std::string lines;
    for (StageCase c : stage_cases()) {
        if (!cases_.empty() && std::find(cases_.begin(), cases_.end(), c.name) == cases_.end())
            continue;
        const double splats = scale_ * splats_scale_, pixels = scale_ * pixels_scale_;
        if (c.kind != StageCase::Kind::one)
            c.splats = std::max(1, static_cast<int>(splats * c.splats));
        c.width = std::max(16, static_cast<int>(std::sqrt(pixels) * c.width));
        c.height = std::max(16, static_cast<int>(std::sqrt(pixels) * c.height));
        c.size_px *= std::sqrt(pixels / splats);
        const bool full_size = splats == 1 && pixels == 1;
        c.surface = training;
        const Measured m = on_device(device, [&](auto tag) {
            using Device = decltype(tag);
            return training ? measure_training<Device>(c, options, warm_up_, repetitions_)
                            : measure<Device>(c, channels, warm_up_, repetitions_);
        });
        const JsonValue stages =
            m.timings.json([&](const std::string& stage, double median_ms, JsonValue& line) {
                const double floor = full_size && device.cuda ? floor_ms(stage, c.name, m.channels,
                                                                         m.compared_pixels > 0)
                                                              : 0;
                if (floor > 0) line.add("floor_ms", floor).add("ratio", median_ms / floor);
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
        json.add("bench", "stages")
            .add("version", kVersion)
            .add("device", device.description)
            .add("threads", thread_count())
            .add("case", c.name)
            .add("width", c.width)
            .add("height", c.height)
            .add("channels", kChannelNames[static_cast<int>(m.channels)])
            .add("counters", counters)
            .add("losses", losses)
            .add("stages", stages)
            .add("unaccounted_share", m.unaccounted);
        std::printf("%s\n", json_text(json).c_str());
        lines += json_text(json) + "\n";
        if (quiet_) continue;
        std::fprintf(stderr, "%s, %d x %d, %s, %s\n", c.name.c_str(), c.width, c.height,
                     kChannelNames[static_cast<int>(m.channels)], device.description.c_str());
        m.timings.print();
        std::fprintf(stderr, "  in no stage, with all waits: %.1f %%\n", 100 * m.unaccounted);
        if (training) std::fprintf(stderr, "  losses %s\n", json_text(losses).c_str());
        std::fprintf(stderr, "  counters %s\n", json_text(counters).c_str());
    }
    if (!out_.empty()) write_text_file(out_, lines), spdlog::info("Results: {}", out_);
    return static_cast<int>(ExitCode::done);
}

}  // namespace tvsgs
