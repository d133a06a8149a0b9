// tvsgs-blocks run: one block as an ordinary tvsgs-train, and done.json when it has ended.
#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <memory>

#include "apps/blocks/subcommands.h"
#include "apps/train/command.h"
#include "io/built_in_configs.h"
#include "io/json_value.h"
#include "io/manifest.h"
#include "io/read_file.h"
#include "pipeline/blocks_seams.h"
#include "pipeline/checkpoints.h"
#include "pipeline/exposures.h"
#include "pipeline/run_folder.h"
#include "pipeline/run_options.h"
#include "pipeline/sky.h"

namespace tvsgs {

namespace fs = std::filesystem;

BlockLock::BlockLock(const std::string& folder)
    : lock_(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
    held_ = lock_ >= 0 && flock(lock_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
}

BlockLock::~BlockLock() {
    if (lock_ >= 0) close(lock_);
}

void run_train(const std::vector<std::string>& words) {
    std::vector<std::string> copied = words;
    std::vector<char*> argv;
    for (std::string& word : copied) argv.push_back(word.data());
    argv.push_back(nullptr);
    train_command(static_cast<int>(words.size()), argv.data());
}

namespace {

struct RunArguments {
    std::string folder, scene, device = "auto";
    int block = 0;
    int checkpoint_every = 5000;
    bool again = false, seam_pass = false;

    BlockStage stage() const { return seam_pass ? BlockStage::seams : BlockStage::training; }
    std::vector<std::string> settings;
};

/// Of the whole, as split resolved them.
RunOptions whole_options(const BlocksManifest& manifest) {
    RunOptions options;
    OptionTable table;
    options.add_to(table);
    table.read_file(manifest.folder + "/config.json");
    return options;
}

/// The scene is the one that was split.
void check_scene(const BlocksManifest& manifest, const std::string& scene) {
    RunOptions options = whole_options(manifest);
    options.scene.path = scene;
    if (const std::uint32_t found = scene_identity(options.scene); found != manifest.scene_crc)
        throw Error(
            ExitCode::input,
            str(scene, ": its images or cameras are not those of the scene that ", manifest.folder,
                " was split from; name that one by --scene, or split "
                "again"));
}

/// Seconds, splats and peak of the run, as the last line of its log has them.
void read_summary(const std::string& log, BlockResult& result) {
    const auto damaged = [](const std::string& why) { throw Error(ExitCode::input, why); };
    for (const JsonValue& line : parse_json_lines(read_bytes(log), log, damaged)) {
        if (line["event"].text_or("") != "done") continue;
        result.seconds = line["seconds"].number_or(0);
        result.splats = static_cast<std::int64_t>(line["gaussians"].number_or(0));
        result.peak_bytes = static_cast<std::int64_t>(line["peak_bytes"].number_or(0));
    }
}

/// Words for tvsgs-train that say what a block of `blocks` is of.
std::vector<std::string> block_words(const std::string& blocks,
                                     const std::string& scene,
                                     const std::string& folder,
                                     const BlockInputs& inputs) {
    std::vector<std::string> words{"tvsgs-train",
                                   "--scene",
                                   scene,
                                   "--train-list",
                                   folder + "/views.txt",
                                   "--init-ply",
                                   folder + "/points.ply"};
    if (inputs.fixed_splats > 0)
        words.insert(words.end(), {"--set", "init.fixed_splats=" + folder + "/fixed.ply"});
    if (has_exposures(blocks))
        words.insert(words.end(), {"--set", "loss.photometric.exposure_from=" + blocks});
    if (has_sky_file(blocks))
        words.insert(words.end(), {"--set", "loss.photometric.sky_from=" + blocks});
    return words;
}

/// Splats of the neighbours that vote in the seam pass of a block.
PointCloud voters_around(const BlocksManifest& manifest, int block) {
    const RunOptions options = whole_options(manifest);
    PointCloud voters;
    for (const int b : neighbours_of_block(manifest, block)) {
        const BlockResult result = require_block_result(manifest, b);
        const Gaussians<Cpu> splats =
            read_splats(manifest.block_folder(b) + "/" + result.files.front().name, manifest.origin,
                        options.train);
        const PointCloud more = seam_voters(manifest, block, surface_of_block(manifest, splats, b));
        voters.positions.insert(voters.positions.end(), more.positions.begin(),
                                more.positions.end());
    }
    return voters;
}

/// A block's training goes on for 5 % of its iterations, 250 at least, without growth, and its
/// neighbours' splats vote; both sides of a seam then settle on one surface.
std::vector<std::string> seam_words(const BlocksManifest& manifest, const std::string& folder) {
    const int more = std::max(250, manifest.iterations / 20);
    std::vector<std::string> words{"--iterations",       std::to_string(manifest.iterations + more),
                                   "--fixed-points",     folder + "/voters.ply",
                                   "--checkpoint-every", "0"};
    const auto set = [&words](const std::string& key, const std::string& value) {
        words.insert(words.end(), {"--set", key + "=" + value});
    };
    set("tv.fixed_check", "false"), set("densify.enabled", "false");
    const RunOptions options = whole_options(manifest);
    if (!options.train.tv.enabled ||
        (options.train.loss.tv_normal.weight == 0 && options.train.loss.tv_position.weight == 0)) {
        // Dense settings have no votes: those of the sparse ones.
        RunOptions sparse;
        OptionTable table;
        sparse.add_to(table);
        table.read_text("the sparse settings", built_in_config(kSparseConfig));
        for (const Option& option : table.options())
            if (!option.source.empty() &&
                (option.key.starts_with("tv.") || option.key.starts_with("loss.tv_")))
                set(option.key, option.get());
        set("tv.enabled", "true");
    }
    return words;
}

/// A run that ended, and its process before it could say so.
bool cannot_go_on(const std::string& run) {
    std::error_code code;
    return holds_splats(run) &&
           fs::directory_iterator(run + "/checkpoints", code) == fs::directory_iterator();
}

/// Trains while the block counts as not trained. What is refused before it has replaced anything
/// leaves the block as it was.
template <class Train>
void without_record(const BlocksManifest& manifest,
                    int block,
                    BlockStage stage,
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
                read_block_result(manifest, block, stage);
            } catch (const Error&) {
                fs::remove(record);
            }
        }
        throw;
    }
}

int run_block(const RunArguments& a, bool quiet) {
    // Runs keep these paths, and are gone on with from other folders.
    const BlocksManifest manifest =
        read_manifest(fs::absolute(a.folder).lexically_normal().string());
    if (a.block < 1 || a.block > manifest.count())
        throw Error(ExitCode::usage, str("--block ", a.block, ": ", a.folder, " has blocks 1 to ",
                                         manifest.count()));
    const std::string folder = manifest.block_folder(a.block), run = folder + "/run";
    const BlockInputs inputs = read_block_inputs(manifest, a.block);
    const BlockLock lock(folder);
    if (lock.held())
        throw Error(ExitCode::usage, str("block ", a.block,
                                         ": another tvsgs-blocks is training it "
                                         "in ",
                                         folder, "; wait for it"));
    const bool seams = a.seam_pass;
    const std::string out = seams ? folder + "/seam" : run;
    if (!a.again)
        if (const auto done = read_block_result(manifest, a.block, a.stage())) {
            spdlog::info("block {}: done already, {} splats; --again trains it anew", a.block,
                         done->splats);
            return 0;
        }
    const std::string scene = a.scene.empty() ? manifest.scene : a.scene;
    check_scene(manifest, scene);
    BlockResult result;
    result.block = a.block, result.split = manifest.split, result.program = kVersion;

    std::vector<std::string> words = block_words(manifest.folder, scene, folder, inputs), more;
    if (seams) {
        const BlockResult trained = require_block_result(manifest, a.block);
        result.from = trained_state(manifest, a.block);
        if (!open_checkpoint(run))
            throw Error(ExitCode::input,
                        str("block ", a.block, ": ", run,
                            "/checkpoints is empty, so there is nothing that the seam pass could "
                            "go on from; tvsgs-blocks run ",
                            a.folder, " --block ", a.block, " --again trains the block anew"));
        const PointCloud voters = voters_around(manifest, a.block);
        if (voters.positions.size() < 3) {  // nobody beside it
            result.splats = trained.splats, result.files = trained.files;
            write_block_result(manifest, result, a.stage());
            spdlog::info("block {}: no splats of neighbours within reach; it stays", a.block);
            return 0;
        }
        write_cloud_ply(folder + "/voters.ply", voters, manifest.origin);
        more = seam_words(manifest, folder);
    } else {
        more = {"--config", folder + "/config.json", "--checkpoint-every",
                std::to_string(a.checkpoint_every)};
    }
    words.insert(words.end(), more.begin(), more.end());
    words.insert(words.end(), {"--out", out, "--device", a.device});
    for (const std::string& setting : a.settings) words.insert(words.end(), {"--set", setting});
    if (quiet) words.push_back("--quiet");
    // The seam pass begins with the last state of the training, and is short: it starts again.
    if (seams)
        words.insert(words.end(), {"--overwrite", "--resume", run});
    else
        words.push_back(a.again || cannot_go_on(run) ? "--overwrite" : "--resume");
    const std::string record = folder + (seams ? "/seam.json" : "/done.json");
    with_context(str("training block ", a.block), [&] {
        without_record(manifest, a.block, a.stage(), record, [&] { run_train(words); });
    });

    read_summary(out + "/log.jsonl", result);
    const std::string splats = find_splats(out);
    result.files = {record_of(folder, fs::path(splats).lexically_relative(folder).string()),
                    record_of(folder, seams ? "seam/config.json" : "run/config.json")};
    write_block_result(manifest, result, a.stage());
    spdlog::info("block {} of {}: {}, {} splats in {:.1f} s", a.block, manifest.count(),
                 seams ? "seam pass done" : "done", result.splats, result.seconds);
    say_next({"tvsgs-blocks", "status", a.folder}, "says what is left to do");
    return 0;
}

}  // namespace

BlocksCommand add_blocks_run(CLI::App& app) {
    const auto a = std::make_shared<RunArguments>();
    CLI::App* const command = app.add_subcommand(
        "run", "train one block; does nothing when it is done, goes on where it was stopped");
    add_blocks_folder(*command, a->folder);
    command->add_option("--block", a->block, "which one, from 1 on")->required();
    command->add_option("-s,--scene", a->scene, "folder of the scene [where it was split]");
    command->add_option("--device", a->device, "auto, cpu, cuda or cuda:N");
    command
        ->add_option("--checkpoint-every", a->checkpoint_every,
                     "iterations between checkpoints; 0: only when the run is stopped")
        ->check(CLI::Range(0, 1000000000));
    command->add_option("--set", a->settings, "KEY=VALUE for tvsgs-train")->expected(1)->take_all();
    command->add_flag("--seam-pass", a->seam_pass,
                      "when the block and its neighbours are done: go on for a short time with the "
                      "neighbours' splats as voters");
    command->add_flag("--again", a->again, "from the beginning, whatever is there");
    return {command, [a](bool quiet) { return run_block(*a, quiet); }};
}

}  // namespace tvsgs
