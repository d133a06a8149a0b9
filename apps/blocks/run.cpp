// tvsgs-blocks run: trains one block with tvsgs-train and writes done.json when it has finished.
#include <filesystem>
#include <memory>

#include "apps/blocks/subcommands.h"
#include "apps/train/command.h"
#include "core/grouped.h"
#include "core/progress.h"
#include "io/files/json_value.h"
#include "io/files/read_file.h"
#include "pipeline/run/run_folder.h"
#include "pipeline/scene/exposures.h"
#include "pipeline/scene/sky.h"

namespace tvsgs {

namespace fs = std::filesystem;

void run_train(const std::vector<std::string>& words) {
    std::vector<std::string> copied = words;
    std::vector<char*> argv;
    for (std::string& word : copied) argv.push_back(word.data());
    argv.push_back(nullptr);
    train_command(int(words.size()), argv.data(), true);
}

RunOptions whole_options(const BlocksManifest& manifest, const std::vector<std::string>& settings) {
    Configuration whole;
    whole.table.read_file(manifest.folder + "/config.json");
    whole.table.set_all(settings);
    return whole.options;
}

void check_scene(const BlocksManifest& manifest, const std::string& scene) {
    RunOptions options = whole_options(manifest);
    options.scene.path = scene;
    if (const std::uint32_t found = scene_identity(options.scene); found != manifest.scene_crc)
        throw input_error(scene, ": other images or cameras than when ", manifest.folder,
                          " was split; give that scene with --scene, or split again");
}

namespace {

/// Reads seconds, splats and peak memory from the last line of a run's log.
void read_summary(const std::string& log, BlockResult& result) {
    const auto damaged = [](const std::string& why) { throw input_error(why); };
    for (const JsonValue& line : parse_json_lines(read_bytes(log), log, damaged)) {
        if (line["event"].text_or("") != "done") continue;
        result.seconds = line["seconds"].number_or(0);
        result.splats = std::int64_t(line["gaussians"].number_or(0));
        result.peak_bytes = std::int64_t(line["peak_bytes"].number_or(0));
    }
}

/// Arguments of tvsgs-train for a block.
std::vector<std::string> block_words(const std::string& blocks,
                                     const std::string& scene,
                                     const std::string& folder,
                                     const BlockInputs& inputs) {
    std::vector<std::string> words{"tvsgs-train"};
    words.insert(words.end(), {"--scene", scene, "--train-list", folder + "/views.txt",
                               "--init-ply", folder + "/points.ply"});
    if (inputs.fixed_splats > 0)
        words.insert(words.end(), {"--set", "init.fixed_splats=" + folder + "/fixed.ply"});
    if (has_exposures(blocks))
        words.insert(words.end(), {"--set", "loss.photometric.exposure_from=" + blocks});
    if (has_sky_file(blocks))
        words.insert(words.end(), {"--set", "loss.photometric.sky_from=" + blocks});
    return words;
}

/// Whether a run finished but its process ended before done.json was written.
bool cannot_go_on(const std::string& run) {
    std::error_code code;
    return holds_splats(run) &&
           fs::directory_iterator(run + "/checkpoints", code) == fs::directory_iterator();
}

/// Trains while the block counts as untrained. If tvsgs-train refuses before it has replaced
/// anything, the block keeps its state.
template <class Train>
void without_record(const BlocksManifest& manifest,
                    int block,
                    const std::string& record,
                    const Train& train) {
    std::error_code code;
    const std::string was = fs::is_regular_file(record, code) ? read_bytes(record) : "";
    fs::remove(record);
    try {
        train();
    } catch (const Error&) {
        if (!was.empty()) {
            write_text_file(record, was);
            try {
                read_block_result(manifest, block);
            } catch (const Error&) {
                fs::remove(record);
            }
        }
        throw;
    }
}

int run_block(const RunArguments& a) {
    // Absolute, because runs store these paths and can be resumed from other folders.
    const BlocksManifest manifest =
        read_manifest(fs::absolute(a.folder).lexically_normal().string());
    if (a.block < 1 || a.block > manifest.count())
        throw usage_error("--block ", a.block, ": ", a.folder, " has blocks 1 to ",
                          manifest.count());
    const std::string folder = manifest.block_folder(a.block), run = folder + "/run";
    const BlockInputs inputs = read_block_inputs(manifest, a.block);
    const FolderLock lock(folder);
    if (lock.held())
        throw usage_error("block ", a.block, ": another tvsgs-blocks trains it in ", folder,
                          "; wait for it");
    if (!a.again)
        if (const auto done = read_block_result(manifest, a.block)) {
            spdlog::info("Block {} is done, {} splats; --again trains it again", a.block,
                         grouped(done->splats));
            return 0;
        }
    const std::string scene = a.scene.empty() ? manifest.scene : a.scene;
    check_scene(manifest, scene);
    BlockResult result;
    result.block = a.block, result.split = manifest.split, result.program = kVersion;

    std::vector<std::string> words = block_words(manifest.folder, scene, folder, inputs);
    words.insert(words.end(), {"--config", folder + "/config.json", "--checkpoint-every",
                               std::to_string(a.checkpoint_every), "--out", run, "--device",
                               a.device, "--progress", a.progress});
    for (const std::string& setting : a.settings) words.insert(words.end(), {"--set", setting});
    if (is_quiet()) words.push_back("--quiet");
    words.push_back(a.again || cannot_go_on(run) ? "--overwrite" : "--resume");
    with_context(str("training block ", a.block), [&] {
        without_record(manifest, a.block, folder + "/done.json", [&] { run_train(words); });
    });

    read_summary(run + "/log.jsonl", result);
    const std::string splats = find_splats(run);
    result.files = {record_of(folder, fs::path(splats).lexically_relative(folder).string()),
                    record_of(folder, "run/config.json")};
    write_block_result(manifest, result);
    spdlog::info("Block {} of {} is done: {} splats in {:.1f} s", a.block, manifest.count(),
                 grouped(result.splats), result.seconds);
    say_next({"tvsgs-blocks", "status", a.folder}, "see what is left to do");
    return 0;
}

}  // namespace

Subcommand add_blocks_run(CLI::App& app) {
    const auto a = std::make_shared<RunArguments>();
    CLI::App* const command = app.add_subcommand(
        "run", "train one block, or all; skips finished blocks, continues stopped ones");
    add_blocks_folder(*command, a->folder);
    CLI::Option* const block =
        command->add_option("--block", a->block, "number of the block to train, from 1");
    CLI::Option* const gpus =
        command->add_option("--gpus", a->gpus,
                            "train all unfinished blocks on these GPUs, one block per GPU at a "
                            "time: all, or numbers such as 0,2");
    CLI::Option* const jobs = add_number(*command, "--jobs", a->jobs, 1, 1024,
                                         "train all unfinished blocks on the CPU, N at a time");
    command->add_option("-s,--scene", a->scene, "folder of the scene [as when it was split]");
    CLI::Option* const device =
        command->add_option("--device", a->device, "auto, cpu, cuda or cuda:N");
    add_number(*command, "--checkpoint-every", a->checkpoint_every, 0, 1000000000,
               "iterations between checkpoints; 0: only when stopped");
    add_repeated(*command, "--set", a->settings, "key for tvsgs-train");
    CLI::Option* const again =
        command->add_flag("--again", a->again, "train from the beginning, even if finished");
    add_choice(*command, "--progress", a->progress, {"auto", "plain", "json"},
               "form of the progress: auto, plain or json");
    gpus->excludes(block)->excludes(jobs)->excludes(device)->excludes(again);
    jobs->excludes(block)->excludes(device)->excludes(again);
    return {command, [=] {
                if (block->count() > 0) return run_block(*a);
                if (gpus->count() + jobs->count() == 0)
                    throw usage_error(
                        "give --block N for one block, --gpus all for all blocks on the GPUs, or "
                        "--jobs N for all on the CPU");
                choose_progress_style(a->progress);
                return run_all_blocks(*a);
            }};
}

}  // namespace tvsgs
