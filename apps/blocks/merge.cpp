// tvsgs-blocks merge: joins the splats of all blocks to one run.
#include <map>
#include <memory>

#include "apps/blocks/subcommands.h"
#include "core/grouped.h"
#include "io/files/atomic_file.h"
#include "io/files/json_value.h"
#include "io/files/read_file.h"
#include "io/scene/georeference.h"
#include "pipeline/blocks/blocks_merge.h"
#include "pipeline/run/run_folder.h"
#include "pipeline/run/run_options.h"
#include "pipeline/scene/sky.h"

namespace tvsgs {
namespace {

struct MergeArguments {
    std::string folder, out, scene;
    bool overwrite = false;
    double fade = 3;
};

/// Reads the results of all blocks. Throws for the first block without a valid result.
std::vector<BlockResult> require_results(const BlocksManifest& manifest) {
    std::vector<BlockResult> results;
    for (int block = 1; block <= manifest.count(); ++block)
        results.push_back(require_block_result(manifest, block));
    return results;
}

/// cameras.json of the whole scene: each view once, by name.
std::string cameras_of_blocks(const BlocksManifest& manifest) {
    std::map<std::string, JsonValue> cameras;
    for (int block = 1; block <= manifest.count(); ++block) {
        const std::string file = manifest.block_folder(block) + "/run/cameras.json";
        const JsonValue list = parse_json_value(read_bytes(file), file);
        for (const JsonValue& camera : list.items)
            cameras.emplace(camera["img_name"].text_or(""), camera);
    }
    std::string text = "[";
    int id = 0;
    for (auto& [name, camera] : cameras) {
        camera.set("id", double(id));
        text += (id++ ? ",\n" : "\n") + json_text(camera);
    }
    return text + "\n]\n";
}

int merge(const MergeArguments& a) {
    const BlocksManifest manifest = read_manifest(a.folder);
    for (const FileRecord& file : manifest.files)
        if (const auto fault = fault_of(manifest.folder, file);
            fault && file.name.find('/') == std::string::npos)
            throw input_error(manifest.folder, "/", file.name, " ", *fault,
                              "; run tvsgs-blocks split again, into another folder");
    const std::vector<BlockResult> results = require_results(manifest);
    Configuration configuration;
    auto& [options, table] = configuration;
    table.read_file(manifest.folder + "/config.json");
    table.set("scene.path", a.scene.empty() ? manifest.scene : a.scene, "--scene");
    if (lies_in(a.out, manifest.folder))
        throw usage_error("--out ", a.out, ": lies inside the folder of the blocks, ",
                          manifest.folder, "; choose a folder outside");
    require_free_run_folder(a.out, a.overwrite, false, options.scene);

    // 1. The splats inside of each block's cell, then the far splats.
    std::vector<Gaussians<Cpu>> parts;
    std::int64_t own = 0, far_reach = 0, peak = 0;
    double seconds = 0, longest = 0;
    for (const BlockResult& result : results) {
        const std::string file =
            manifest.block_folder(result.block) + "/" + result.files.front().name;
        const Gaussians<Cpu> splats = with_context(str("merging block ", result.block), [&] {
            return read_splats(file, manifest.origin, options.train);
        });
        BlockSplats part = part_of_block(manifest, splats, result.block, a.fade);
        parts.push_back(std::move(part.splats));
        own += part.own, far_reach += part.far_reach;
        seconds += result.seconds, longest = std::max(longest, result.seconds);
        peak = std::max(peak, result.peak_bytes);
    }
    const Gaussians<Cpu> coarse =
        read_splats(manifest.folder + "/coarse.ply", manifest.origin, options.train);
    parts.push_back(part_of_block(manifest, coarse, 0, 0).splats);
    const std::int64_t far = parts.back().size();
    const Gaussians<Cpu> whole = join_splats(parts, options.train.model.sh_degree);
    if (whole.size() == 0)
        throw input_error(manifest.folder, ": no block has a splat inside its cell");
    const std::string cameras = cameras_of_blocks(manifest);
    read_sky(options.train.loss.photometric, manifest.folder);

    // 2. An ordinary run. Starts only after everything has been read.
    RunFolder run(a.out);
    run.save_config(
        table.json(JsonValue().add("version", kVersion).add("merged_from", manifest.folder)));
    write_text_file(run.path() + "/cameras.json", cameras);
    write_sky(run.path(), options.train.loss.photometric);
    if (const auto place = read_georeference(options.scene.path))
        write_georeference(run.path(), *place);
    const bool flat = make_backbone<Cpu>(options.train.backbone, options.train.render)->traits.flat;
    run.save_splats(whole, manifest.iterations, manifest.origin,
                    flat ? PlyScales::two : PlyScales::three);
    run.log(JsonValue()
                .add("event", "done")
                .add("iteration", manifest.iterations)
                .add("seconds", seconds)
                .add("gaussians", whole.size())
                .add("peak_bytes", peak)
                .add("blocks", manifest.count())
                .add("longest_seconds", longest)
                .add("far_splats", far));
    if (far_reach > 0)
        spdlog::info(
            "{} splats reach beyond the margin of {:.4g}; a larger --margin at split avoids seams",
            grouped(far_reach), manifest.margin);
    spdlog::info(
        "{}: {} splats of {} blocks, {} of neighbour blocks at the cuts, {} far ones of the coarse "
        "run; training took {:.1f} s, {:.1f} s the longest block",
        a.out, grouped(own), manifest.count(), grouped(whole.size() - own - far), grouped(far),
        seconds, longest);
    say_next({"tvsgs-extract-mesh", "--model", a.out}, "make the mesh");
    return 0;
}

}  // namespace

Subcommand add_blocks_merge(CLI::App& app) {
    const auto a = std::make_shared<MergeArguments>();
    CLI::App* const command = app.add_subcommand("merge", "merge the blocks into one run");
    add_blocks_folder(*command, a->folder);
    command->add_option("-o,--out", a->out, "run folder to write")->required();
    command->add_option("-s,--scene", a->scene, "folder of the scene [as when it was split]");
    add_number(*command, "--fade", a->fade, 0.0, 10.0,
               "standard deviations of a splat over which it fades out on either side of a cut; 0: "
               "hard cut at its centre");
    command->add_flag("--overwrite", a->overwrite, "replace an earlier run in the folder");
    return {command, [a] { return merge(*a); }};
}

}  // namespace tvsgs
