// tvsgs-blocks run --gpus, --jobs: the blocks side by side, each a `tvsgs-blocks run --block N`.
#include <algorithm>
#include <filesystem>

#include "apps/blocks/subcommands.h"
#include "core/device/device_choice.h"
#include "core/device/threads.h"
#include "core/progress.h"
#include "pipeline/blocks/blocks_schedule.h"
#include "plan/memory.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

/// "cuda:0", "cuda:1"; or "cpu 1", "cpu 2".
std::vector<std::string> places_of(const RunArguments& a) {
    std::vector<std::string> places;
    for (int job = 1; job <= a.jobs; ++job) places.push_back(str("cpu ", job));
    if (!a.gpus.empty())
        for (const int gpu : choose_gpus(a.gpus)) places.push_back(str("cuda:", gpu));
    return places;
}

/// A damaged result counts as not done; the block's process reports the damage.
bool is_done(const BlocksManifest& manifest, int block) {
    try {
        return read_block_result(manifest, block).has_value();
    } catch (const Error&) {
        return false;
    }
}

std::vector<BlockJob> jobs_of(const BlocksManifest& manifest, int iterations) {
    std::vector<BlockJob> jobs;
    for (int block = 1; block <= manifest.count(); ++block)
        if (!is_done(manifest, block))
            jobs.push_back(
                {block, manifest.block_folder(block) + "/train.log", double(iterations)});
    return jobs;
}

/// Threads and host memory of each of `places` parallel processes.
struct Share {
    int threads;
    std::string host_memory;  // empty: as in the settings

    Share(const RunOptions& options, std::size_t places)
        : threads(std::max(1, thread_count() / int(places))) {
        if (options.memory.host.empty())
            host_memory =
                str((memory_limits(options.memory, false).host >> 20) / std::int64_t(places), "M");
    }
};

ChildProcess::Command command_of(const BlocksManifest& manifest,
                                 const RunArguments& a,
                                 int block,
                                 const std::string& place,
                                 const std::string& program) {
    ChildProcess::Command command;
    command.own_group = true;
    command.words = {program, "run", manifest.folder};
    const auto add = [&](const char* flag, const std::string& value) {
        command.words.insert(command.words.end(), {flag, value});
    };
    add("--block", str(block)), add("--device", a.jobs > 0 ? "cpu" : place);
    add("--progress", "json"), add("--checkpoint-every", str(a.checkpoint_every));
    if (!a.scene.empty()) add("--scene", a.scene);
    for (const std::string& setting : a.settings) add("--set", setting);
    return command;
}

/// Progress of all blocks: rewritten in place on a terminal, else one line per block every 10 s.
/// `shown`: time of the last call that showed it.
void show_blocks(const std::vector<BlockProgress>& running, int done, int waiting, double& shown) {
    constexpr double kInPlace = 0.2, kPlain = 10;  // seconds
    const ProgressStyle style = progress_style();
    if (style == ProgressStyle::quiet || style == ProgressStyle::json) return;
    const double now = steady_seconds();
    if (now - shown < (progress_in_place() ? kInPlace : kPlain)) return;
    shown = now;
    std::vector<std::string> lines;
    for (const BlockProgress& b : running)
        lines.push_back(
            progress_text(str("block ", b.block, " on ", b.place), b.seconds, b.share, b.left));
    if (progress_in_place())
        lines.push_back(
            str(done, " blocks done, ", running.size(), " training, ", waiting, " waiting"));
    show_progress_lines(lines);
}

}  // namespace

int run_all_blocks(const RunArguments& a) {
    const BlocksManifest manifest =
        read_manifest(fs::absolute(a.folder).lexically_normal().string());
    const FolderLock lock(manifest.folder);
    if (lock.held())
        throw usage_error(a.folder,
                          ": another tvsgs-blocks run trains all blocks; wait for it, or stop it");
    const RunOptions options = whole_options(manifest, a.settings);
    BlockSchedule schedule;
    schedule.places = places_of(a);
    check_scene(manifest, a.scene.empty() ? manifest.scene : a.scene);
    const std::vector<BlockJob> jobs = jobs_of(manifest, options.train.iterations);
    schedule.places.resize(std::min(schedule.places.size(), std::max(jobs.size(), std::size_t{1})));
    const Share whole(options, 1), part(options, schedule.places.size());
    const std::string program = fs::read_symlink("/proc/self/exe").string();
    schedule.command = [&](int block, const std::string& place, bool alone) {
        if (!fs::is_directory(manifest.block_folder(block)))
            throw Error(ExitCode::input, manifest.block_folder(block),
                        " is missing; run tvsgs-blocks split again, into another folder");
        ChildProcess::Command command = command_of(manifest, a, block, place, program);
        const Share& share = alone ? whole : part;
        command.environment.push_back(str("OMP_NUM_THREADS=", share.threads));
        if (!share.host_memory.empty())
            command.environment.push_back("TVSGS_MEMORY__HOST=" + share.host_memory);
        return command;
    };
    schedule.on_report = [](int block, const JsonValue& report) {
        if (progress_style() != ProgressStyle::json) return;
        JsonValue line = report;
        line.set("block", double(block));
        std::fprintf(stderr, "%s\n", json_text(line).c_str());
    };
    const double begin = steady_seconds();
    double shown = begin;
    schedule.show = [&](const std::vector<BlockProgress>& running, int done, int waiting) {
        show_blocks(running, done, waiting, shown);
    };
    const std::vector<BlockFailure> failures = run_blocks(jobs, schedule);
    if (failures.empty()) {
        spdlog::info("All {} blocks are done, {} of them in {:.0f} s", manifest.count(),
                     jobs.size(), steady_seconds() - begin);
        say_next({"tvsgs-blocks", "merge", a.folder, "--out", "RUN"}, "merge them");
        return 0;
    }
    std::vector<int> blocks;
    for (const BlockFailure& failure : failures) blocks.push_back(failure.block);
    throw Error(static_cast<ExitCode>(failures.front().code),
                str(a.folder, ": ", manifest.count() - int(blocks.size()), " of ", manifest.count(),
                    " blocks are done; block", blocks.size() > 1 ? "s " : " ", block_list(blocks),
                    " failed twice, see above; the same command continues with the rest"));
}

}  // namespace tvsgs
