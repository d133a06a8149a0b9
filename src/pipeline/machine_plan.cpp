#include "pipeline/machine_plan.h"

#include <algorithm>
#include <cstdio>
#include <vector>

#include "core/error.h"

namespace tvsgs {
namespace {

constexpr std::int64_t kGrowth = 5;  // final splats per first one; chosen, not measured
// Millions of splats out of view from which on it is faster that their colours wait, and the share
// in view up to which it is: by measured times, one in view costs as much as five to twelve others
// save.
// [docs/develop/performance.md#colours-that-wait]
constexpr double kMillionsOutOfView = 2.5, kShareInView = 0.13;

/// Three digits.
std::string digits(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.3g", value);
    return text;
}
std::string splats_text(std::int64_t count) {
    return count < 1000000 ? std::to_string(count)
                           : digits(static_cast<double>(count) / 1e6) + " M";
}
double gigabytes(std::int64_t bytes) {
    return static_cast<double>(bytes) / 1e9;
}

/// A way to hold a training on the processes that there are.
struct Level {
    std::string choice;
    Settings settings;
    TrainOptions options;
    MemoryPlan needs;
};

/// In the order in which they are tried; all give the same bits, and the later ones take longer.
std::vector<Level> levels_of(const Scene& scene,
                             const TrainOptions& options,
                             const MachineInputs& in) {
    const bool streams =
                   in.cuda && in.may_stream && options.photo_bytes == 0 && !scene.train.empty(),
               compacts =
                   in.may_compact && options.tv.enabled && options.tv.lists == ListStorage::full,
               crowded = in.cuda && photos_crowd(scene, options, in.limits.device);
    std::vector<Level> levels;
    const int processes = in.processes.all;
    const std::string plain = processes > 1 ? str(processes, in.cuda ? " GPUs" : " processes")
                              : in.cuda     ? "one GPU"
                                            : "one CPU";
    const auto add = [&](const std::string& choice, bool stream, bool compact, bool leave) {
        Level level{choice, {}, options, {}};
        TrainOptions& o = level.options;
        if (stream) {
            o.photo_bytes = 1;
            level.settings.emplace_back("photo_bytes", "1");
        }
        if (compact) {
            o.tv.lists = ListStorage::compact;
            level.settings.emplace_back("tv.lists", "compact");
        }
        if (leave) {
            o.optim.harmonics = KeepHarmonics::host;
            level.settings.emplace_back("optim.harmonics", "host");
        }
        level.needs = estimate_memory(scene, o, in.first, in.cuda, in.processes);
        levels.push_back(std::move(level));
    };
    if (!(streams && crowded)) add(plain, false, false, false);
    if (streams) add("photographs on the host", true, false, false);
    if (compacts && !(streams && crowded)) add("compact lists", false, true, false);
    if (streams && compacts) add("compact lists, photographs on the host", true, true, false);
    const bool fuses = make_backbone<Cpu>(options.backbone, options.render)->fuses();
    if (in.cuda && in.may_leave_harmonics && options.optim.harmonics != KeepHarmonics::host &&
        why_harmonics_stay(scene, options, fuses).empty()) {
        // What costs less has been done by then.
        const std::string before = levels.back().choice;
        add(before == plain ? "colours on the host" : before + ", colours on the host", streams,
            compacts, true);
    }
    return levels;
}

/// How many processes, with a GPU like this each, would hold the expected splats where one does
/// not; 0: not so few as are tried. A step then looks at as many photographs.
int processes_that_hold(const Scene& scene, const Level& level, const MachineInputs& in) {
    if (!in.cuda || in.processes.all > 1) return 0;
    for (const int processes : {2, 4, 8}) {
        TrainOptions o = level.options;
        o.comm.batch = std::max(o.comm.batch, processes);
        o.optim.harmonics = KeepHarmonics::device;  // a batch adds up gradients of all
        if (o.comm.batch > static_cast<int>(scene.train.size())) break;
        const MemoryLimits limits{in.limits.device, in.limits.host / processes};
        const MemoryPlan needs =
            estimate_memory(scene, o, in.first, in.cuda, {processes, processes});
        if (fitting(needs, limits) >= in.expected.count) return processes;
    }
    return 0;
}

}  // namespace

ExpectedSplats expected_splats(const Scene& scene,
                               const TrainOptions& options,
                               std::int64_t first,
                               bool capped) {
    if (!grows(options)) return {first, "the first ones, as none are added"};
    const std::int64_t cap = std::max(first, growth_cap(scene, options.densify));
    if (capped) return {cap, "densify.max_gaussians, or what growth may reach"};
    if (cap <= kGrowth * first) return {cap, "the most that growth may reach"};
    return {kGrowth * first, str(kGrowth, " times the first ones, a guess")};
}

Decision plan_machines(const Scene& scene, const TrainOptions& options, const MachineInputs& in) {
    const std::vector<Level> levels = levels_of(scene, options, in);
    const std::int64_t splats = in.expected.count;
    const auto holds = [&](const Level& level) {
        return fitting(level.needs, in.limits) >= splats;
    };
    auto taken = std::find_if(levels.begin(), levels.end(), holds);
    const bool fits = taken != levels.end();
    if (!fits)
        taken = std::max_element(levels.begin(), levels.end(), [&](const Level& a, const Level& b) {
            return fitting(a.needs, in.limits) < fitting(b.needs, in.limits);
        });

    // Of device and host, whichever the first level fills more.
    const auto share = [&](const MemoryNeed& need, std::int64_t limit) {
        return static_cast<double>(need.at(splats)) / static_cast<double>(limit);
    };
    const MemoryPlan& plain = levels.front().needs;
    const bool of_device =
        in.cuda && share(plain.buffers, in.limits.device) >= share(plain.host, in.limits.host);
    const auto need = [&](const Level& level) -> const MemoryNeed& {
        return of_device ? level.needs.buffers : level.needs.host;
    };
    const std::int64_t limit = of_device ? in.limits.device : in.limits.host;
    const double measured = gigabytes(need(levels.front()).at(splats)),
                 threshold = gigabytes(limit);
    std::string reason =
        str(of_device ? "GPU" : "host", " memory for ", splats_text(splats), " splats (",
            in.expected.source, ") of ", need(levels.front()).per_splat, " B: ", digits(measured),
            measured <= threshold ? " <= " : " > ", digits(threshold), " GB");
    if (&*taken != &levels.front())
        reason += str("; so ", digits(gigabytes(need(*taken).at(splats))), " GB");
    if (taken->options.optim.harmonics == KeepHarmonics::host)
        reason += str("; a step moves up to ",
                      digits(gigabytes(bytes_over_bus(scene, taken->options, splats))),
                      " GB over the bus and back");
    std::string choice = taken->choice;
    if (!fits) {
        const std::int64_t most = fitting(taken->needs, in.limits);
        if (most < in.first) choice = most == 0 ? "none" : "blocks";
        if (most == 0)
            reason += "; the images alone do not fit: smaller ones (-r)";
        else
            reason +=
                str("; ", splats_text(most), " fit", most < in.first ? "" : ", where growth stops",
                    "; all: ", split_command(scene.path, blocks_for(splats, most)));
        if (const int processes = processes_that_hold(scene, *taken, in); processes > 0)
            reason +=
                str(", or ", processes, " GPUs: mpirun -n ", processes,
                    " tvsgs-train ... --set comm.batch=", std::max(options.comm.batch, processes));
    }
    return {"machines", choice, reason, measured, threshold, taken->settings};
}

std::optional<Decision> plan_waiting(const Scene& scene,
                                     const TrainOptions& options,
                                     const MachineInputs& in) {
    if (!in.cuda || !in.may_leave_harmonics || options.optim.harmonics != KeepHarmonics::device)
        return {};
    const double share = share_in_view(scene),
                 out = (1 - share) * static_cast<double>(in.first) / 1e6;
    const bool fuses = make_backbone<Cpu>(options.backbone, options.render)->fuses();
    if (!(out >= kMillionsOutOfView && share <= kShareInView) ||
        !why_harmonics_stay(scene, options, fuses).empty())
        return {};
    TrainOptions waits = options;
    waits.optim.harmonics = KeepHarmonics::waiting;
    if (in.may_stream) waits.photo_bytes = 1;  // which costs no time
    const MemoryPlan needs = estimate_memory(scene, waits, in.first, in.cuda, in.processes);
    if (fitting(needs, in.limits) < in.expected.count) return {};
    return Decision{
        "colours",
        "wait out of view",
        str("millions of splats out of view, of ", splats_text(in.first), ": ", digits(out),
            " >= ", kMillionsOutOfView, "; share in view: ", digits(share), " <= ", kShareInView),
        out,
        kMillionsOutOfView,
        {{"optim.harmonics", "waiting"}}};
}

}  // namespace tvsgs
