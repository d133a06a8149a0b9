#include "bench_stages.h"

#include <omp.h>

#include <cmath>

#include "bench_stats.h"
#include "core/rng.h"
#include "io/atomic_file.h"
#include "optim/adam.h"
#include "optim/splat_order.h"
#include "render/photometric.h"

namespace tvsgs {
namespace {

constexpr int kShDegree = 3;

/// Shortest times that an H200's memory, arithmetic and shuffles allow for w540 and w1200 at full
/// size, ms, with channels color; of color_plane where they differ.
struct Floor {
    const char* stage;
    double w540, w1200, w540_plane, w1200_plane;
};
constexpr Floor kFloors[] = {
    {"project", 0.130, 0.130, 0.130, 0.130},
    {"tile lists", 0.040, 0.054, 0.040, 0.054},
    {"blend", 0.045, 0.127, 0.049, 0.139},
    {"photometric loss", 0.014, 0.051, 0.014, 0.051},
    {"blend backward", 0.117, 0.388, 0.117, 0.388},  // with the sums over each splat's slots
    {"project backward and Adam", 0.313, 0.313, 0.313, 0.313},
};

/// 0 where none is known.
double floor_ms(const std::string& stage, const std::string& name, Channels channels) {
    for (const Floor& f : kFloors)
        if (stage == f.stage && channels != Channels::plane) {
            const bool plane = has_plane(channels);
            if (name.starts_with("w540")) return plane ? f.w540_plane : f.w540;
            if (name.starts_with("w1200")) return plane ? f.w1200_plane : f.w1200;
        }
    return 0;
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

struct Measured {
    Timings timings;
    RenderCounts counts;
    BlendWork work;
    std::int64_t bytes;
};

/// One view again and again: first as in training, with one wait at the end, then with a wait
/// around every stage.
template <class Device>
Measured measure(const StageCase& c,
                 Channels channels,
                 AdamForm form,
                 bool atomic,
                 int warm_up,
                 int repetitions) {
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
        copy(std::vector<float>(pixels, share), dL_dimages.distance);
    }
    const auto backbone = make_backbone<Device>("pgsr", {});
    if (atomic) backbone->use_atomic_sums();
    // At rate 0 Adam works as ever, but the view stays the same.
    Adam<Device> adam({0, 0, 1, 0, 0, 0, 0, 0}, splats, form);

    const auto iteration = [&](StageClock<Device>& clock) {
        const auto& images =
            backbone->forward(splats, camera, kShDegree, channels,
                              [&](Span<const float> radii_px) { adam.catch_up(radii_px, splats); });
        if (has_color(channels))
            clock("photometric loss", [&] {
                dL_dimages.color.fill_zero();
                photometric_loss(images.color.span(), photo.span(), c.width, c.height, {0.8f, 0.2f},
                                 scratch, dL_dimages.color.span(), pixel_loss.span(), Device{});
            });
        const ViewGradients gradients = backbone->blend_backward(dL_dimages);
        clock("project backward and Adam",
              [&] { adam.step(1, 1, gradients, no_more, splats, true); });
    };
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
    backbone->clock() = StageClock<Device>(true);
    for (int i = 0; i < repetitions; ++i) {
        StageClock<Device> own(true);
        backbone->clock().clear();
        iteration(own);
        for (const auto* clock : {&own, &backbone->clock()})
            for (const StageTime& stage : clock->stages())
                out.timings.add(stage.name, 1e3 * stage.seconds);
    }
    out.counts = backbone->counts();
    out.work = backbone->blend_work();
    out.bytes = memory_use(Device{}).current_bytes - before;
    return out;
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

Gaussians<Cpu> make_stage_splats(const StageCase& c) {
    using Kind = StageCase::Kind;
    const double f = c.width;
    Gaussians<Cpu> g;
    resize(g, c.splats, kShDegree);
    fill_zero(g);
#pragma omp parallel for schedule(static)
    for (int splat = 0; splat < c.splats; ++splat) {
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
    }
    if (c.sorted) sort_by_place(g);
    return g;
}

StagesBench::StagesBench(CLI::App& app)
    : command_(app.add_subcommand("stages", "times of the parts of a training iteration")) {
    CLI::App& c = *command_;
    std::vector<std::string> names;
    for (const StageCase& known : stage_cases()) names.push_back(known.name);
    c.add_option("--case", cases_, "one of the synthetic views; all where not given")
        ->expected(1)
        ->take_all()
        ->check(CLI::IsMember(names));
    c.add_option("--scale", scale_,
                 "share of each case's splats and pixels; floors are given at 1 only")
        ->check(CLI::Range(1e-6, 4.0))
        ->capture_default_str();
    c.add_option("--splats-scale", splats_scale_,
                 "times as many splats, smaller ones: as many over each pixel")
        ->check(CLI::Range(1e-6, 100.0))
        ->capture_default_str();
    c.add_option("--pixels-scale", pixels_scale_,
                 "times as many pixels, splats larger with them: as many over each pixel")
        ->check(CLI::Range(1e-6, 100.0))
        ->capture_default_str();
    c.add_option("--channels", channels_, "what is rendered")
        ->check(CLI::IsMember({"color", "color_plane", "plane"}))
        ->capture_default_str();
    c.add_option("--adam", adam_, "as the key optim.adam")
        ->check(CLI::IsMember({"dense", "lazy", "visible"}))
        ->capture_default_str();
    c.add_flag("--atomic-sums", atomic_,
               "gradients summed by floating-point atomics: what the same bits every time cost");
    c.add_option("--repetitions", repetitions_, "timed repetitions")
        ->check(CLI::Range(1, 100'000))
        ->capture_default_str();
    c.add_option("--warm-up", warm_up_, "repetitions before these")
        ->check(CLI::Range(1, 100'000))
        ->capture_default_str();
    c.add_option("--device", device_, "auto, cpu, cuda or cuda:N")->capture_default_str();
    c.add_option("--out", out_, "file to write the JSON to as well");
    c.add_flag("--quiet", quiet_, "warnings and errors only");
}

int StagesBench::run() const {
    const DeviceChoice device = choose_device(device_);
    if (atomic_ && !device.cuda)
        throw Error(ExitCode::usage, "--atomic-sums: only on a GPU; expected --device cuda");
    const Channels channels = channels_ == "color"         ? Channels::color
                              : channels_ == "color_plane" ? Channels::color_plane
                                                           : Channels::plane;
    const AdamForm form = adam_ == "dense"  ? AdamForm::dense
                          : adam_ == "lazy" ? AdamForm::lazy
                                            : AdamForm::visible;
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
        const Measured m = on_device(device, [&](auto tag) {
            return measure<decltype(tag)>(c, channels, form, atomic_, warm_up_, repetitions_);
        });
        const std::string stages =
            m.timings.json([&](const std::string& stage, double median_ms, JsonLine& line) {
                const double floor =
                    full_size && device.cuda ? floor_ms(stage, c.name, channels) : 0;
                if (floor > 0) line.add("floor_ms", floor).add("ratio", median_ms / floor);
            });
        const auto per_pixel = [&c](std::int64_t count) {
            return static_cast<double>(count) / (static_cast<double>(c.width) * c.height);
        };
        JsonLine counters, json;
        counters.add("splats", c.splats)
            .add("visible", m.counts.visible)
            .add("slots", m.counts.slots)
            .add("warp_tests", m.work.tests)
            .add("warp_hits", m.work.hits)
            .add("warp_draws", m.work.draws)
            .add("warp_sums", m.work.sums)
            .add("evaluations_per_pixel", per_pixel(m.work.evaluations))
            .add("contributions_per_pixel", per_pixel(m.work.contributions))
            .add("bytes_held", m.bytes);
        json.add("bench", "stages")
            .add("version", kVersion)
            .add("device", device.description)
            .add("threads", omp_get_max_threads())
            .add("case", c.name)
            .add("width", c.width)
            .add("height", c.height)
            .add("channels", channels_)
            .add("adam", adam_)
            .add("atomic_sums", atomic_)
            .add_json("counters", counters.text())
            .add_json("stages", stages);
        std::printf("%s\n", json.text().c_str());
        lines += json.text() + "\n";
        if (quiet_) continue;
        std::fprintf(stderr, "%s, %d x %d, %s, %s\n", c.name.c_str(), c.width, c.height,
                     channels_.c_str(), device.description.c_str());
        m.timings.print();
        std::fprintf(stderr, "  counters %s\n", counters.text().c_str());
    }
    if (!out_.empty()) write_text_file(out_, lines);
    return static_cast<int>(ExitCode::done);
}

}  // namespace tvsgs
