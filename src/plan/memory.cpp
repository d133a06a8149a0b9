#include "plan/memory.h"

#include <algorithm>
#include <cmath>

#include "core/device/buffer.h"
#include "core/error.h"
#include "core/grouped.h"
#include "core/parse_numbers.h"
#include "io/files/json_value.h"
#include "mesh/fuse/device_algorithms.h"
#include "optim/views/device_views.h"
#include "plan/figures.h"

namespace tvsgs {
namespace {

constexpr double kShareOfFreeMemory = 0.9;  // the rest is for the driver and small allocations
constexpr std::int64_t kMiB = 1 << 20;
// Splats of a block's margin over its own ones. Chosen; tvsgs-blocks counts them.
constexpr double kBlockMargin = 0.2;

// Bytes of a view: radius, place and statistics of each splat; records and entries in the lists of
// tiles of each splat in view (measured, with room to spare):
constexpr std::int64_t kPerViewSplat = 28, kPerSplatInView = 200, kPerFragment = 100,
                       kFragmentsPerSplat = 4;
// Images, their derivatives and scratch of the losses:
constexpr std::int64_t kPerColorPixel = 110, kPerPlanePixel = 76, kPerOtherPixel = 84;
// Votes: records, field and scratch memory, without the lists; their part of a checkpoint:
constexpr std::int64_t kPerVoter = 450, kPerVoterState = 120;
constexpr std::int64_t kProgram = 32 * kMiB;

/// Bytes of the mask that DeviceViews makes for the terms.
std::int64_t mask_bytes(const View& view, const LossNeeds& needs) {
    return needs.view_maps.contains("mask") ? std::int64_t(view.mask.pixels.size() * sizeof(float))
                                            : 0;
}

/// Bytes without the mask.
std::int64_t photo_bytes(const View& view) {
    std::size_t bytes = view.photo.pixels.size() + view.grey.pixels.size();
    for (const ViewMap& map : view.maps) bytes += map.values.size() * sizeof(float);
    return std::int64_t(bytes);
}

/// Bytes on the device, as DeviceViews holds them.
std::int64_t device_bytes(const std::vector<View>& views, const LossNeeds& needs) {
    std::int64_t bytes = 0;
    for (const View& v : views) bytes += photo_bytes(v) + mask_bytes(v, needs);
    return bytes;
}

/// Bytes on the host, as a scene holds them; images in a file take none.
std::int64_t host_bytes(const std::vector<View>& views) {
    std::int64_t bytes = 0;
    for (const View& v : views) {
        for (const ImageU8* image : {&v.photo, &v.grey, &v.mask})
            if (!image->pixels.in_file()) bytes += std::int64_t(image->pixels.size());
        for (const ViewMap& map : v.maps) bytes += std::int64_t(map.values.size() * sizeof(float));
    }
    return bytes;
}

bool in_file(const std::vector<View>& views) {
    return !views.empty() && views.front().photo.pixels.in_file();
}

std::int64_t largest_view(const Scene& scene) {
    std::int64_t pixels = 0;
    for (const auto* views : {&scene.train, &scene.test})
        for (const View& v : *views)
            pixels = std::max(pixels, std::int64_t{v.camera.width_px} * v.camera.height_px);
    return pixels;
}

template <class Device>
std::int64_t limit_of(Device device, const std::string& key, const std::string& given) {
    return given.empty() ? std::int64_t(kShareOfFreeMemory * double(free_bytes(device)))
                         : parse_bytes(key, given);
}

std::int64_t fitting(const MemoryNeed& need, std::int64_t limit) {
    return std::max<std::int64_t>(limit - need.fixed, 0) /
           std::max<std::int64_t>(need.per_splat, 1);
}

/// `most`: number of splats that fit.
void require(const char* where,
             const std::string& scene,
             const MemoryNeed& need,
             std::int64_t splats,
             std::int64_t limit,
             std::int64_t most) {
    if (need.at(splats) <= limit) return;
    const std::string what = str("training needs about ", grouped(need.at(splats) / kMiB),
                                 " MiB of ", where, " memory for its first ", grouped(splats),
                                 " splats, and ", grouped(limit / kMiB), " MiB may be used");
    // If not one splat fits, blocks do not help.
    const std::string remedy =
        most == 0 ? ""
                  : str(", enough for ", grouped(most),
                        "; make blocks that fit: ", split_command(scene, blocks_for(splats, most)));
    throw out_of_memory(what + remedy);
}

}  // namespace

double share_in_view(const Scene& scene) {
    constexpr std::size_t kSample = 1000;
    constexpr double kSpare = 0.25, kBeside = 0.05;
    const std::vector<Vec3f>& points = scene.points.positions;
    if (points.empty()) return 1;
    double most = 0;
    for (const View& view : scene.train) {
        std::size_t in_view = 0, all = 0;
        for (std::size_t i = 0; i < points.size(); i += 1 + points.size() / kSample)
            ++all, in_view += is_in_view(view.camera, points[i]);
        most = std::max(most, double(in_view) / double(all));
    }
    return std::min(1.0, (1 + kSpare) * most + kBeside);
}

std::int64_t view_bytes_per_splat(double share_in_view) {
    return kPerViewSplat +
           std::llround(share_in_view * (kPerSplatInView + kFragmentsPerSplat * kPerFragment));
}

MemoryLimits memory_limits(const MemoryOptions& memory, bool cuda) {
    MemoryLimits limits;
    limits.host = limit_of(Cpu{}, "memory.host", memory.host);
    limits.device = limits.host;
    if (!memory.gpu.empty()) parse_bytes("memory.gpu", memory.gpu);  // also where it does not count
    if constexpr (kHasCuda) {
        if (cuda) limits.device = limit_of(Cuda{}, "memory.gpu", memory.gpu);
    }
    return limits;
}

std::int64_t disk_bytes(std::int64_t splats, int sh_degree, int checkpoints) {
    const std::int64_t parameters = 11 + 3 * std::int64_t{sh_count(sh_degree)};
    constexpr std::int64_t kNormal = 3, kStates = 3, kOthers = 30;  // Adam has two moments
    const std::int64_t ply = parameters + kNormal, checkpoint = kStates * parameters + kOthers;
    return splats * std::int64_t{sizeof(float)} * (ply + checkpoints * checkpoint);
}

std::int64_t fitting(const MemoryPlan& needs, const MemoryLimits& limits) {
    return std::min(fitting(needs.buffers, limits.device), fitting(needs.host, limits.host));
}

bool grows(const TrainOptions& o) {
    return o.densify.enabled && o.iterations > o.densify.from;
}

std::int64_t growth_cap(const Scene& scene, const DensifyOptions& options) {
    std::int64_t cap = options.max_gaussians;
    if (const float share = options.max_per_pixel; share > 0) {
        double pixels = 0;
        for (const View& view : scene.train)
            pixels += double(view.camera.width_px) * view.camera.height_px;
        cap = std::min(cap, std::int64_t(std::ceil(share * pixels)));
    }
    return cap;
}

bool photos_crowd(const Scene& scene, const TrainOptions& options, std::int64_t device_limit) {
    return options.photo_bytes == 0 &&
           device_bytes(scene.train, needs_of(options.loss)) > device_limit / 2;
}

std::int64_t blocks_for(std::int64_t splats, std::int64_t fitting) {
    return std::int64_t(std::ceil((1 + kBlockMargin) * double(splats) / double(fitting)));
}

std::string split_command(const std::string& scene, std::int64_t blocks) {
    return str("tvsgs-blocks split --scene ", scene, " --blocks ", blocks, " --out BLOCKS");
}

/// On a CPU, copies of the photographs would take the memory that the file saves.
std::int64_t photo_budget(const Scene& scene, const TrainOptions& options, bool cuda) {
    return !cuda && options.photo_bytes == 0 && in_file(scene.train) ? 1 : options.photo_bytes;
}

MemoryPlan estimate_memory(const Scene& scene,
                           const TrainOptions& o,
                           std::int64_t splats,
                           bool cuda) {
    const LossNeeds needs = needs_of(o.loss);
    const bool plane = has(needs.maps, kGeometryMaps);
    const bool votes = o.tv.enabled;
    const std::int64_t geometry = 4 * 11,
                       parameters = geometry + 4 * 3 * sh_count(o.model.sh_degree);
    // A fused step keeps only the gradients of terms without an image in memory.
    const std::int64_t fixed = scene.fixed_splats ? scene.fixed_splats->size() : 0;
    const bool compact = make_backbone<Cpu>(o.backbone, o.render)->traits.fuses,
               fuses = compact && fixed == 0;
    const std::int64_t gradients = !fuses ? parameters : needs.splat_gradients ? geometry : 0;
    const std::int64_t renders = 1 + needs.rendered_views;

    MemoryPlan plan;
    plan.first = splats, plan.grows = grows(o), plan.cuda = cuda;
    MemoryNeed& buffers = plan.buffers;
    // Values, two moments and gradients. Growth needs room for another copy, and growing buffers
    // have a quarter to spare.
    const std::int64_t drawn = renders * view_bytes_per_splat(compact ? share_in_view(scene) : 1);
    buffers.per_splat = 3 * parameters + gradients + drawn;
    // With fixed splats, values and gradients of all drawn splats are kept once more.
    if (fixed > 0) buffers.per_splat += 2 * parameters;
    if (o.cameras.refine) buffers.per_splat += sizeof(CameraGradient<float>);
    if (votes) buffers.per_splat += kPerVoter + (o.tv.lists == ListStorage::full ? 8 : 2) * o.tv.k;
    if (grows(o)) buffers.per_splat = (buffers.per_splat + parameters) * 5 / 4;
    const std::int64_t per_pixel =
        kPerColorPixel + (plane ? kPerPlanePixel : 0) + needs.rendered_views * kPerOtherPixel;
    const std::int64_t photos = device_bytes(scene.train, needs),
                       hold = photo_budget(scene, o, cuda);
    const bool all = hold == 0 || photos <= hold;
    // Bytes cached by losses; largest view with photographs and maps.
    std::int64_t kept = 0, most = 0;
    for (const View& v : scene.train) {
        kept += std::int64_t{4} * needs.kept_per_pixel * v.camera.width_px * v.camera.height_px;
        most = std::max(most, photo_bytes(v) + mask_bytes(v, needs));
    }
    // All photographs, or a few with their grey images.
    buffers.fixed = (all ? photos : views_in_use(needs) * (most + largest_view(scene))) +
                    per_pixel * largest_view(scene) + kept + fixed * (3 * parameters + drawn);

    // Two checkpoints are in memory while the next one is made.
    const std::int64_t state = 3 * parameters + (votes ? kPerVoterState : 0);
    plan.host.per_splat = 2 * state + parameters;
    plan.host.fixed = kProgram + host_bytes(scene.train) + host_bytes(scene.test) + 2 * kept +
                      fixed * parameters +
                      std::int64_t(scene.points.positions.size() * 3 * sizeof(Vec3f));
    if (!cuda) {
        buffers.per_splat += 2 * state;
        plan.host.per_splat = buffers.per_splat + parameters;
        plan.host.fixed += buffers.fixed;
    }
    return plan;
}

MemoryPlan plan_memory(const Scene& scene,
                       const MemoryOptions& memory,
                       std::int64_t splats,
                       bool cuda,
                       TrainOptions& options) {
    MemoryPlan plan = estimate_memory(scene, options, splats, cuda);
    plan.limits = memory_limits(memory, cuda);
    options.photo_bytes = photo_budget(scene, options, cuda);
    if (!memory.host.empty()) set_memory_limit(Cpu{}, plan.limits.host);
    if constexpr (kHasCuda) {
        if (cuda && !memory.gpu.empty()) set_memory_limit(Cuda{}, plan.limits.device);
    }
    if (cuda && photos_crowd(scene, options, plan.limits.device)) {
        options.photo_bytes = plan.limits.device / 4;
        plan.buffers = estimate_memory(scene, options, splats, cuda).buffers;
    }
    const std::int64_t fit = fitting(plan, plan.limits);
    if (cuda) require("GPU", scene.path, plan.buffers, splats, plan.limits.device, fit);
    require("host", scene.path, plan.host, splats, plan.limits.host, fit);

    plan.most = std::min(growth_cap(scene, options.densify), fit);
    plan.most = std::max(plan.most, std::min<std::int64_t>(splats, options.densify.max_gaussians));
    options.densify.max_gaussians = int(plan.most);
    return plan;
}

std::string MemoryPlan::text() const {
    const auto needed = [](std::int64_t bytes, std::int64_t limit) {
        return str(bytes_text(double(bytes)), " of ", bytes_text(double(limit)));
    };
    std::string text = needed(first_bytes(), cuda ? limits.device : limits.host);
    if (cuda) text += str(" on the GPU, ", needed(host.at(first), limits.host), " on the host");
    text += str(" for ", grouped(first), " splats");
    return grows ? str(text, "; growth stops at ", grouped(most)) : text;
}

std::string MemoryPlan::json() const {
    const auto need = [](const MemoryNeed& n, std::int64_t limit, std::int64_t splats) {
        return JsonValue()
            .add("fixed_bytes", n.fixed)
            .add("bytes_per_splat", n.per_splat)
            .add("first_bytes", n.at(splats))
            .add("limit_bytes", limit);
    };
    return json_text(JsonValue()
                         .add("first_splats", first)
                         .add("most_splats", most)
                         .add("device", need(buffers, limits.device, first))
                         .add("host", need(host, limits.host, first)));
}

}  // namespace tvsgs
