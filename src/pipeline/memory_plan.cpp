#include "pipeline/memory_plan.h"

#include <algorithm>
#include <cmath>

#include "core/buffer.h"
#include "core/error.h"
#include "core/log.h"
#include "core/parse_numbers.h"
#include "io/config.h"
#include "mesh/device_algorithms.h"
#include "optim/device_views.h"

namespace tvsgs {
namespace {

constexpr double kShareOfFreeMemory = 0.9;  // the rest is the driver's, and of what is not counted
constexpr std::int64_t kMiB = 1 << 20;

// Measured, bytes. Splats of a view, what growth asks of them, and lists of tiles:
constexpr std::int64_t kPerViewSplat = 190, kPerFragment = 100, kFragmentsPerSplat = 4;
// Images, their derivatives and scratch of the losses:
constexpr std::int64_t kPerColorPixel = 110, kPerPlanePixel = 76, kPerOtherPixel = 84;
// Votes: records, field and scratch, without the lists; what a checkpoint has of them:
constexpr std::int64_t kPerVoter = 450, kPerVoterState = 120;
constexpr std::int64_t kProgram = 32 * kMiB;

/// What DeviceViews makes of a mask that terms look at.
std::int64_t mask_bytes(const View& view, const LossNeeds& needs) {
    const bool needed =
        std::find(needs.view_maps.begin(), needs.view_maps.end(), "mask") != needs.view_maps.end();
    return needed ? static_cast<std::int64_t>(view.mask.pixels.size() * sizeof(float)) : 0;
}

/// Beside the mask.
std::int64_t photo_bytes(const View& view) {
    std::size_t bytes = view.photo.pixels.size() + view.grey.pixels.size();
    for (const ViewMap& map : view.maps) bytes += map.values.size() * sizeof(float);
    return static_cast<std::int64_t>(bytes);
}

/// As DeviceViews has them.
std::int64_t device_bytes(const std::vector<View>& views, const LossNeeds& needs) {
    std::int64_t bytes = 0;
    for (const View& v : views) bytes += photo_bytes(v) + mask_bytes(v, needs);
    return bytes;
}

/// As a scene has them.
std::int64_t host_bytes(const std::vector<View>& views) {
    std::int64_t bytes = 0;
    for (const View& v : views)
        bytes += photo_bytes(v) + static_cast<std::int64_t>(v.mask.pixels.size());
    return bytes;
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
    const std::int64_t limit =
        given.empty() ? static_cast<std::int64_t>(kShareOfFreeMemory *
                                                  static_cast<double>(free_bytes(device)))
                      : parse_bytes(key, given);
    if (!given.empty()) set_memory_limit(device, limit);
    return limit;
}

/// How many splats fit; INT64_MAX where they take nothing.
std::int64_t fitting(const MemoryNeed& need, std::int64_t limit) {
    return std::max<std::int64_t>(limit - need.fixed, 0) /
           std::max<std::int64_t>(need.per_splat, 1);
}

void require(const char* where, const MemoryNeed& need, std::int64_t splats, std::int64_t limit) {
    if (need.at(splats) > limit)
        throw out_of_memory(str("training would need about ", need.at(splats) / kMiB, " MiB of ",
                                where, " memory for its first ", splats, " splats, and ",
                                limit / kMiB, " MiB may be used"));
}

}  // namespace

MemoryPlan estimate_memory(const Scene& scene,
                           const TrainOptions& o,
                           std::int64_t splats,
                           bool cuda) {
    const bool grows = o.densify.enabled && o.iterations > o.densify.from;
    const LossNeeds needs = needs_of(o.loss);
    const bool plane = has(needs.maps, kGeometryMaps);
    const bool votes = o.tv.enabled;
    const std::int64_t geometry = 4 * 11,
                       parameters = geometry + 4 * 3 * sh_count(o.model.sh_degree);
    // A fused step wants in memory what terms give without the image alone.
    const std::int64_t fixed = scene.fixed_splats ? scene.fixed_splats->size() : 0;
    const bool fuses = make_backbone<Cpu>(o.backbone, o.render)->fuses() && fixed == 0;
    const std::int64_t gradients = !fuses ? parameters : needs.splat_gradients ? geometry : 0;
    const std::int64_t renders = 1 + needs.rendered_views;

    MemoryPlan plan;
    plan.first = splats;
    MemoryNeed& buffers = plan.buffers;
    // Values, two moments and gradients; growing takes room for another copy, and buffers that grow
    // have a quarter to spare.
    const std::int64_t drawn = renders * (kPerViewSplat + kFragmentsPerSplat * kPerFragment);
    buffers.per_splat = 3 * parameters + gradients + drawn;
    // Beside fixed splats: values and gradients of all that is drawn, once more.
    if (fixed > 0) buffers.per_splat += 2 * parameters;
    if (o.cameras.refine) buffers.per_splat += sizeof(CameraGradient<float>);
    if (votes)
        buffers.per_splat +=
            kPerVoter + (o.tv.lists == ListStorage::full ? 8 * o.tv.k : 2 * o.tv.k);
    if (grows) buffers.per_splat = (buffers.per_splat + parameters) * 5 / 4;
    const std::int64_t per_pixel =
        kPerColorPixel + (plane ? kPerPlanePixel : 0) + needs.rendered_views * kPerOtherPixel;
    const std::int64_t photos = device_bytes(scene.train, needs);
    const bool all = o.photo_bytes == 0 || photos <= o.photo_bytes;
    // By terms; photographs and maps of one view; masks that are to be copied.
    std::int64_t kept = 0, most = 0, masks = 0;
    for (const View& v : scene.train) {
        kept += std::int64_t{4} * needs.kept_per_pixel * v.camera.width_px * v.camera.height_px;
        most = std::max(most, photo_bytes(v) + mask_bytes(v, needs));
        masks += mask_bytes(v, needs);
    }
    // Else those of a few, grey ones beside the colours.
    buffers.fixed = (all ? photos : views_at_hand(needs) * (most + largest_view(scene))) +
                    per_pixel * largest_view(scene) + kept + fixed * (3 * parameters + drawn);

    // A checkpoint is held until the next one is, and both meanwhile.
    const std::int64_t state = 3 * parameters + (votes ? kPerVoterState : 0);
    plan.host.per_splat = 2 * state + parameters;
    plan.host.fixed = kProgram + host_bytes(scene.train) + host_bytes(scene.test) + masks +
                      2 * kept + fixed * parameters +
                      static_cast<std::int64_t>(scene.points.positions.size() * 3 * sizeof(Vec3f));
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
    plan.host_limit = limit_of(Cpu{}, "memory.host", memory.host);
    plan.device_limit = plan.host_limit;
    if (!memory.gpu.empty()) parse_bytes("memory.gpu", memory.gpu);  // also where it does not count
    if constexpr (kHasCuda) {
        if (cuda) plan.device_limit = limit_of(Cuda{}, "memory.gpu", memory.gpu);
    }
    if (cuda && options.photo_bytes == 0 &&
        device_bytes(scene.train, needs_of(options.loss)) > plan.device_limit / 2) {
        options.photo_bytes = plan.device_limit / 4;
        plan.buffers = estimate_memory(scene, options, splats, cuda).buffers;
    }
    if (cuda) require("GPU", plan.buffers, splats, plan.device_limit);
    require("host", plan.host, splats, plan.host_limit);

    plan.most = std::min({std::int64_t{options.densify.max_gaussians},
                          cuda ? fitting(plan.buffers, plan.device_limit) : INT64_MAX,
                          fitting(plan.host, plan.host_limit)});
    if (const float share = options.densify.max_per_pixel; share > 0) {
        double pixels = 0;
        for (const View& view : scene.train)
            pixels += double(view.camera.width_px) * view.camera.height_px;
        plan.most = std::min(plan.most, static_cast<std::int64_t>(std::ceil(share * pixels)));
    }
    plan.most = std::max(plan.most, std::min<std::int64_t>(splats, options.densify.max_gaussians));
    options.densify.max_gaussians = static_cast<int>(plan.most);
    return plan;
}

std::string MemoryPlan::text() const {
    const std::int64_t bytes = std::max(buffers.at(first), std::int64_t{1});
    return str("memory: about ", bytes / kMiB, " MiB for ", first, " splats and ",
               buffers.per_splat, " bytes for each more; ", device_limit / kMiB,
               " MiB may be used, and growth stops at ", most, " splats; on the host ",
               host.at(first) / kMiB, " of ", host_limit / kMiB, " MiB");
}

std::string MemoryPlan::json() const {
    const auto need = [](const MemoryNeed& n, std::int64_t limit, std::int64_t splats) {
        return JsonLine()
            .add("fixed_bytes", n.fixed)
            .add("bytes_per_splat", n.per_splat)
            .add("first_bytes", n.at(splats))
            .add("limit_bytes", limit)
            .text();
    };
    return JsonLine()
        .add("first_splats", first)
        .add("most_splats", most)
        .add_json("device", need(buffers, device_limit, first))
        .add_json("host", need(host, host_limit, first))
        .text();
}

}  // namespace tvsgs
