#include "plan/machines.h"

#include <algorithm>
#include <vector>

#include "core/error.h"
#include "plan/figures.h"

namespace tvsgs {
namespace {

constexpr std::int64_t kGrowth = 5;  // final splats per first one; chosen, not measured

std::string splats_text(std::int64_t count) {
    return count < 1000000 ? std::to_string(count)
                           : number(static_cast<double>(count) / 1e6) + " M";
}
double gigabytes(std::int64_t bytes) {
    return static_cast<double>(bytes) / 1e9;
}

/// A way to hold a training in memory.
struct Level {
    std::string choice;
    Settings settings;
    TrainOptions options;
    MemoryPlan needs;
};

/// In the order of trial. All give the same bits; later ones take longer.
std::vector<Level> levels_of(const Scene& scene,
                             const TrainOptions& options,
                             const MachineInputs& in) {
    const bool streams =
                   in.cuda && in.may_stream && options.photo_bytes == 0 && !scene.train.empty(),
               compacts =
                   in.may_compact && options.tv.enabled && options.tv.lists == ListStorage::full,
               crowded = in.cuda && photos_crowd(scene, options, in.limits.device);
    std::vector<Level> levels;
    const auto add = [&](const std::string& choice, bool stream, bool compact) {
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
        level.needs = estimate_memory(scene, o, in.first, in.cuda);
        levels.push_back(std::move(level));
    };
    if (!(streams && crowded)) add(in.cuda ? "one GPU" : "one CPU", false, false);
    if (streams) add("photographs on the host", true, false);
    if (compacts && !(streams && crowded)) add("compact lists", false, true);
    if (streams && compacts) add("compact lists, photographs on the host", true, true);
    return levels;
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

Decision decide_machines(const Scene& scene, const TrainOptions& options, const MachineInputs& in) {
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

    // The reason states the memory that the first level fills more: of the device, or of the host.
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
            in.expected.source, ") of ", need(levels.front()).per_splat, " B: ", number(measured),
            measured <= threshold ? " <= " : " > ", number(threshold), " GB");
    if (&*taken != &levels.front())
        reason += str("; so ", number(gigabytes(need(*taken).at(splats))), " GB");
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
    }
    return {"machines", choice, reason, measured, threshold, taken->settings};
}

}  // namespace tvsgs
