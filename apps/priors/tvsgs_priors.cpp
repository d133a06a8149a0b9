// tvsgs-priors: a network of the user's and calibrated photographs in, maps for the readers of
// priors out.
#include <algorithm>
#include <filesystem>

#include "apps/common/command_line.h"
#include "apps/common/key_flags.h"
#include "apps/priors/network.h"
#include "apps/priors/preprocess.h"
#include "apps/priors/priors_folder.h"
#include "apps/priors/recipe.h"
#include "apps/priors/recipe_flags.h"
#include "core/log.h"
#include "core/progress.h"
#include "io/load_views.h"
#include "io/scene_reader.h"

namespace tvsgs::priors {
namespace {

namespace fs = std::filesystem;

struct Arguments {
    std::string model, out, device = "cpu";
    RecipeFlags recipe;
    bool overwrite = false, list_presets = false, quiet = false;
};

void add_scene_flags(KeyFlags& flags) {
    const char* group = "Scene";
    flags.add("-s,--scene,--source-path,--data", "scene.path",
              "folder of the scene: photographs with their cameras", group);
    flags.add("--format", "scene.format",
              "auto, colmap, blender, nerfstudio, idr or mvsnet: layout of the folder [auto]",
              group);
    flags.add("--images", "scene.images", "folder of the photographs inside the scene [images]",
              group);
    flags.add("--split", "scene.split", "list of splits.json to use; its list 'test' is left out",
              group);
    flags.add("--train-list", "scene.train_list", "file with one image to use per line", group);
    flags.add("--views", "scene.views", "views by index into the sorted images: 23,24,33", group);
    flags.add("-n,--num-views", "scene.num_views", "that many views, evenly chosen [all]", group);
}

Arguments parse(int argc, char** argv, OptionTable& table) {
    Arguments arguments;
    CLI::App app{
        "Runs a network, which the user brings as an ONNX file, over a scene's photographs and "
        "writes its maps for the readers of priors.",
        "tvsgs-priors"};
    app.get_formatter()->column_width(46);
    KeyFlags flags(app, table);
    add_scene_flags(flags);
    const char* group = "Network";
    app.add_option("--model", arguments.model, "the network, an ONNX file")->group(group);
    app.add_option("--device", arguments.device,
                   "cpu: OpenCV's DNN module as Debian builds it runs nowhere else")
        ->group(group);
    arguments.recipe.add_to(app);
    group = "Output";
    app.add_option("-o,--out,--output-folder", arguments.out,
                   "folder for the maps and priors.json [SCENE/priors]")
        ->group(group);
    app.add_flag("--overwrite", arguments.overwrite,
                 "replace maps of this kind that tvsgs has written")
        ->group(group);
    app.add_flag("--list-presets", arguments.list_presets, "print the table of public models")
        ->group(group);
    app.add_flag("--quiet", arguments.quiet, "warnings and errors only")->group(group);
    parse_command_line(app, argc, argv);
    table.read_environment();
    flags.set_keys(table);
    return arguments;
}

std::vector<ViewSource> photographs_of(const ChosenViews& chosen) {
    std::vector<ViewSource> photographs;
    const ColmapModel& model = chosen.layout.model;
    for (const int i : chosen.split.train) {
        const auto at = static_cast<std::size_t>(i);
        const ColmapImage& image = model.images[at];
        photographs.push_back({&image, model.cameras.at(image.camera_id), *chosen.files[at],
                               std::nullopt, chosen.layout.alpha_on_black});
    }
    return photographs;
}

/// As training sees it, but for its lens: three channels.
ImageU8 read_photograph(const ViewSource& source) {
    ImageU8 alpha;
    bool was_turned = false;
    return read_photo(source, alpha, was_turned);
}

int command(int argc, char** argv) {
    // 1. What is asked for.
    SceneOptions scene_options;
    scene_options.min_train_views = 1;
    scene_options.need_points = false;
    OptionTable table;
    table.add("scene", scene_options);
    Arguments arguments = parse(argc, argv, table);
    if (arguments.list_presets) {
        for (const std::string& line : preset_table()) std::printf("%s\n", line.c_str());
        return 0;
    }
    init_log(arguments.quiet ? Verbosity::quiet : Verbosity::normal);
    if (scene_options.path.empty())
        throw Error(ExitCode::usage, "no scene given; expected --scene DIR; see --help");
    if (arguments.model.empty())
        throw Error(ExitCode::usage, "no network given; expected --model FILE.onnx; see --help");
    if (arguments.device != "cpu" && arguments.device != "auto")
        throw Error(ExitCode::usage, str("--device ", arguments.device,
                                         ": networks run on the CPU only; expected cpu"));
    Recipe recipe = arguments.recipe.recipe();
    if (arguments.out.empty()) arguments.out = (fs::path(scene_options.path) / "priors").string();

    // 2. The scene and the network.
    const ChosenViews chosen = choose_views(scene_options);
    const std::vector<ViewSource> photographs = photographs_of(chosen);
    std::vector<std::string> views;
    for (const ViewSource& photograph : photographs) views.push_back(photograph.image->name);
    Network network(arguments.model, recipe.output);
    recipe.size = network.settled(recipe.size, arguments.recipe.size_of_preset());
    const std::string producer =
        str("tvsgs-priors ", fs::path(arguments.model).filename().string(), ", sha256 ",
            network.sha256(), ", output ", network.output(), ", OpenCV ", Network::opencv_version(),
            ", input ", text_of(recipe.size, recipe.fit), ", ", normalisation_of(recipe),
            ", gives ", meaning_of(recipe));
    PriorsFolder folder(arguments.out, recipe.kind, section_of(recipe, producer),
                        arguments.overwrite, scene_options.path, views);
    std::vector<ViewSource> wanted;
    std::copy_if(photographs.begin(), photographs.end(), std::back_inserter(wanted),
                 [&](const ViewSource& p) { return !folder.has(p.image->name); });
    spdlog::info("{}: {} of {}: {}; {} photographs on the CPU{}", arguments.out,
                 name_of(recipe.kind), fs::path(arguments.model).filename().string(),
                 meaning_of(recipe), wanted.size(),
                 wanted.size() < photographs.size()
                     ? str(", ", photographs.size() - wanted.size(),
                           " maps of an earlier run are kept (--overwrite makes them anew)")
                     : "");

    // 3. The maps.
    Progress progress("photographs", double(wanted.size()));
    for (const ViewSource& photograph : wanted)
        with_context(str("making the ", name_of(recipe.kind), " of ", photograph.file), [&] {
            const ImageU8 photo = read_photograph(photograph);
            const InputPlace place = place_photo(recipe, photo.width, photo.height);
            const Tensor output =
                network.run(input_of(recipe, place, photo), place.width, place.height);
            const ImageF map = map_of(recipe, place, output, arguments.model);
            folder.write(photograph.image->name,
                         map_of_photo(recipe, place, map, photo.width, photo.height));
            progress.advance();
        });
    spdlog::info("{}: {}", arguments.out, name_of(recipe.kind));
    say_next({"tvsgs-train", "--scene", scene_options.path, "--priors", arguments.out},
             "trains with them, where a loss asks for them (--set)");
    return 0;
}

}  // namespace
}  // namespace tvsgs::priors

int main(int argc, char** argv) {
    return tvsgs::run_command([&] { return tvsgs::priors::command(argc, argv); });
}
