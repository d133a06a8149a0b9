#include <algorithm>
#include <vector>

#include "core/error.h"
#include "core/grouped.h"
#include "plan/decide.h"
#include "plan/figures.h"

namespace tvsgs {
namespace {

constexpr std::int64_t kGrowth = 5;  // final splats per first one; chosen, not measured

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
    if (!(streams && crowded)) add(in.cuda ? "GPU" : "CPU", false, false);
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
    if (!grows(options)) return {first, "no new ones"};
    const std::int64_t cap = std::max(first, growth_cap(scene, options.densify));
    if (capped) return {cap, "densify.max_gaussians, or the limit of growth"};
    if (cap <= kGrowth * first) return {cap, "the limit of growth"};
    return {kGrowth * first, str(kGrowth, " times the start points, a guess")};
}

Decision decide_machines(const Scene& scene, const TrainOptions& options, const MachineInputs& in) {
    const std::vector<Level> levels = levels_of(scene, options, in);
    const std::int64_t splats = in.expected.count;
    const auto holds = [&](const Level& level) {
        return fitting(level.needs, in.limits) >= splats;
    };
    auto taken = std::ranges::find_if(levels, holds);
    const bool fits = taken != levels.end();
    if (!fits)
        taken = std::ranges::max_element(levels, [&](const Level& a, const Level& b) {
            return fitting(a.needs, in.limits) < fitting(b.needs, in.limits);
        });

    // The reason states the memory that the first level fills more: of the device, or of the host.
    const auto share = [&](const MemoryNeed& need, std::int64_t limit) {
        return double(need.at(splats)) / double(limit);
    };
    const MemoryPlan& plain = levels.front().needs;
    const bool of_device =
        in.cuda && share(plain.buffers, in.limits.device) >= share(plain.host, in.limits.host);
    const auto need = [&](const Level& level) -> const MemoryNeed& {
        return of_device ? level.needs.buffers : level.needs.host;
    };
    const std::int64_t limit = of_device ? in.limits.device : in.limits.host;
    const auto bytes = [&](const Level& level) { return double(need(level).at(splats)); };
    std::string reason = str(bytes_text(bytes(levels.front())), " of ", bytes_text(double(limit)),
                             of_device ? " GPU memory for " : " host memory for ", grouped(splats),
                             " splats (", in.expected.source, ")");
    if (&*taken != &levels.front()) reason += str("; ", bytes_text(bytes(*taken)), " this way");
    std::string choice = taken->choice;
    if (!fits) {
        const std::int64_t most = fitting(taken->needs, in.limits);
        if (most < in.first) choice = most == 0 ? "none" : "blocks";
        if (most == 0)
            reason += "; the photographs alone do not fit: make them smaller (-r)";
        else
            reason +=
                str("; ", grouped(most), " fit", most < in.first ? "" : ", where growth stops",
                    "; all in blocks: ", split_command(scene.path, blocks_for(splats, most)));
    }
    return {"machines",
            choice,
            reason,
            bytes(levels.front()) / 1e9,
            double(limit) / 1e9,
            taken->settings,
            &*taken == &levels.front() && fits ? "" : choice};
}

}  // namespace tvsgs
