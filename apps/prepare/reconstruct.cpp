#include "apps/prepare/reconstruct.h"

#include <algorithm>
#include <cmath>

#include "apps/prepare/colmap.h"
#include "core/device/threads.h"
#include "core/grouped.h"
#include "core/log.h"
#include "core/progress.h"
#include "io/files/atomic_file.h"
#include "io/files/read_file.h"

namespace tvsgs::prepare {
namespace {

namespace fs = std::filesystem;

/// A long step with its progress and a final message.
class Step {
public:
    explicit Step(std::string what) : what_(std::move(what)), progress_(std::in_place, what_, 1) {}
    /// `share` of the work is done. A smaller share than before only moves the clock.
    void reached(double share) {
        progress_->advance(std::max(0.0, share - done_));
        done_ = std::max(done_, share);
    }
    void done() {
        progress_.reset();
        spdlog::info("{}: {:.0f} s", what_, steady_seconds() - begin_);
    }

private:
    std::string what_;
    std::optional<Progress> progress_;
    double done_ = 0, begin_ = steady_seconds();
};

using Words = std::vector<std::string>;  // a command line

void add_threads(ColmapOptions& of, const std::string& group, const ReconstructOptions& options) {
    // COLMAP chooses by itself otherwise.
    if (options.threads > 0) of.emplace_back(group + ".num_threads", str(options.threads));
}

/// Lens model of the final cameras.
std::string lens_of(const CameraGroup& group, const ReconstructOptions& options) {
    // Estimating two coefficients of each kind needs several photographs.
    return options.lens != "auto"     ? options.lens
           : group.names.size() >= 10 ? "OPENCV"
                                      : "SIMPLE_RADIAL";
}

/// Lens model with one coefficient for the search for poses: with more coefficients, more poses go
/// wrong while there are only two or three photographs.
std::string first_lens(const std::string& lens) {
    if (lens == "RADIAL" || lens == "OPENCV" || lens == "FULL_OPENCV") return "SIMPLE_RADIAL";
    return lens.ends_with("_FISHEYE") ? "SIMPLE_RADIAL_FISHEYE" : lens;
}

void extract_features(Colmap& colmap,
                      const fs::path& work,
                      const fs::path& images,
                      const std::vector<CameraGroup>& groups,
                      const ReconstructOptions& options,
                      std::map<std::string, int>& features) {
    std::size_t all = 0, done = 0;
    for (const CameraGroup& group : groups) all += group.names.size();
    Step step(str("features of ", all, " photographs"));
    for (const CameraGroup& group : groups) {
        const std::string wanted = options.calibration ? options.calibration->model
                                                       : lens_of(group, options),
                          lens = options.calibration ? wanted : first_lens(wanted);
        std::string list;
        for (const std::string& name : group.names) list += name + "\n";
        const std::string list_file = (work / "list.txt").string();
        fs::remove(list_file);
        write_text_file(list_file, list);
        ColmapOptions of = {{"database_path", (work / "database.db").string()},
                            {"image_path", images.string()},
                            {"image_list_path", list_file},
                            {"ImageReader.camera_model", lens},
                            {"ImageReader.single_camera", "1"},
                            {"FeatureExtraction.use_gpu", "0"},
                            {"FeatureExtraction.max_image_size", str(options.feature_size)}};
        add_threads(of, "FeatureExtraction", options);
        if (options.calibration)
            of.emplace_back("ImageReader.camera_params",
                            fmt::format("{:.17g}", fmt::join(options.calibration->params, ",")));
        std::string name;
        colmap.require(colmap.command("feature_extractor", of), [&](std::string_view text) {
            if (text.starts_with("Name:")) name = trimmed(text.substr(5));
            if (const auto count = number_after(text, "Features:"))
                features[name] = static_cast<int>(*count);
            if (text.starts_with("Processed file")) ++done;
            step.reached(static_cast<double>(done) / static_cast<double>(all));
        });
        spdlog::info("camera {} for {} photographs of {}", wanted, group.names.size(),
                     group.description);
    }
    step.done();
}

/// Photographs per block of exhaustive matching: several blocks, so that the progress moves, each
/// with four pairs per thread or more.
int block_size(std::size_t photographs) {
    constexpr int kDefault = 50;  // COLMAP's
    const int least = static_cast<int>(std::ceil(3 * std::sqrt(thread_count()))),
              eighth = static_cast<int>(std::min<std::size_t>(photographs / 8, kDefault));
    return std::max(least, eighth);
}

/// Command lines of the matchers, in their order.
std::vector<Words> match_commands(Colmap& colmap,
                                  const fs::path& work,
                                  std::size_t photographs,
                                  const ReconstructOptions& options) {
    ColmapOptions of = {{"database_path", (work / "database.db").string()},
                        {"FeatureMatching.use_gpu", "0"}};
    add_threads(of, "FeatureMatching", options);
    if (options.matcher == "transitive")
        return {colmap.command("sequential_matcher", of), colmap.command("transitive_matcher", of)};
    if (options.matcher == "exhaustive")
        of.emplace_back("ExhaustiveMatching.block_size", str(block_size(photographs)));
    return {colmap.command(options.matcher + "_matcher", of)};
}

void match(const Colmap& colmap, const std::vector<Words>& commands) {
    for (const Words& command : commands) {
        const std::string& name = command.at(1);
        Step step(name.substr(0, name.find('_')) + " matching");
        colmap.require(command,
                       [&](std::string_view text) { step.reached(share_of_matches(text)); });
        step.done();
    }
}

Words map_command(Colmap& colmap,
                  const fs::path& work,
                  const fs::path& images,
                  const ReconstructOptions& options) {
    ColmapOptions of = {{"database_path", (work / "database.db").string()},
                        {"image_path", images.string()},
                        {"output_path", (work / "models").string()},
                        {"Mapper.min_model_size", "3"}};
    add_threads(of, "Mapper", options);
    if (options.calibration)
        of.insert(of.end(),
                  {{"Mapper.ba_refine_focal_length", "0"}, {"Mapper.ba_refine_extra_params", "0"}});
    return colmap.command("mapper", of);
}

/// Estimates poses, points and lenses; one model for each connected set of photographs, or none.
std::vector<SparseModel> map_all(const Colmap& colmap,
                                 const fs::path& work,
                                 const Words& command,
                                 std::size_t photographs) {
    Step step("poses");
    const fs::path out = work / "models";
    fs::create_directories(out);
    const int code = colmap.run(
        command, [&](std::string_view text) { step.reached(share_of_poses(text, photographs)); });
    std::vector<SparseModel> models;
    for (const auto& entry : fs::directory_iterator(out))
        if (count_images(entry.path().string()) > 0)
            models.push_back(read_sparse_model(entry.path().string()));
    constexpr int kNoModel = 1;  // exit code of most versions if no pair starts a model
    if (code > kNoModel || (code != 0 && !models.empty())) colmap.fail(command, code);
    std::ranges::sort(models, std::greater<>(), [](const SparseModel& model) {
        return std::pair(model.images.size(), model.points.size());
    });
    step.done();
    return models;
}

Words lens_command(Colmap& colmap, const fs::path& work) {
    return colmap.command("bundle_adjuster", {{"input_path", (work / "found").string()},
                                              {"output_path", (work / "refined").string()},
                                              {"BundleAdjustment.refine_principal_point", "0"}});
}

/// Refines a model with the final lenses, and with the principal point of cameras with enough
/// photographs to separate it from the poses.
SparseModel with_lenses(const Colmap& colmap,
                        const fs::path& work,
                        Words command,
                        SparseModel model,
                        const std::vector<CameraGroup>& groups,
                        const ReconstructOptions& options) {
    constexpr std::size_t kPhotographs = 20;
    std::map<std::string, std::string> lenses;  // by photograph
    for (const CameraGroup& group : groups)
        for (const std::string& name : group.names) lenses[name] = lens_of(group, options);
    std::map<std::uint32_t, std::size_t> counts;
    std::map<std::uint32_t, std::string> lens;
    for (const SparseImage& image : model.images)
        ++counts[image.camera_id], lens[image.camera_id] = lenses[image.name];
    const bool centres =
        std::ranges::all_of(counts, [](auto& count) { return count.second >= kPhotographs; });
    bool changed = centres;
    for (SparseCamera& camera : model.cameras) changed |= take_lens(camera, lens[camera.id]);
    if (!changed) return model;
    Step step(centres ? "lens and principal point" : "lens");
    fs::create_directories(work / "refined");
    write_sparse_model((work / "found").string(), model);
    command.back() = centres ? "1" : "0";
    colmap.require(command, [](std::string_view) {});
    step.done();
    return read_sparse_model((work / "refined").string());
}

/// Writes the poses of the model in `options.poses` for these photographs to the folder `given`.
void take_poses(Colmap& colmap,
                const fs::path& given,
                const fs::path& images,
                const ReconstructOptions& options) {
    fs::create_directories(given);
    colmap.require(colmap.command("model_converter", {{"input_path", options.poses},
                                                      {"output_path", given.string()},
                                                      {"output_type", "BIN"}}),
                   [](std::string_view) {});
    SparseModel model = read_sparse_model(given.string());
    for (SparseImage& image : model.images)
        if (const auto to = options.renamed.find(image.name); to != options.renamed.end())
            image.name = to->second;
    std::ranges::sort(model.images, {}, &SparseImage::name);
    std::erase_if(model.images,
                  [&](const SparseImage& image) { return !fs::exists(images / image.name); });
    if (model.images.size() < 2)
        throw input_error(options.poses, ": has poses of ", model.images.size(),
                          " of the photographs; expected 2 or more, with the same paths");
    // The model's points belong to other features.
    model.points.clear();
    for (SparseImage& image : model.images) image.observations.clear();
    fs::remove_all(given);  // newer versions also write rigs and frames, of all its photographs
    write_sparse_model(given.string(), model);
}

Words triangulate_command(Colmap& colmap,
                          const fs::path& work,
                          const fs::path& images,
                          const ReconstructOptions& options) {
    ColmapOptions of = {{"database_path", (work / "database.db").string()},
                        {"image_path", images.string()},
                        {"input_path", (work / "given").string()},
                        {"output_path", (work / "models/0").string()},
                        {"clear_points", "1"}};
    add_threads(of, "Mapper", options);
    return colmap.command("point_triangulator", of);
}

/// Triangulates points for the given poses.
SparseModel triangulate(const Colmap& colmap,
                        const fs::path& work,
                        const Words& command,
                        std::size_t photographs) {
    Step step("points for the given poses");
    const fs::path out = work / "models/0";
    fs::create_directories(out);
    colmap.require(command,
                   [&](std::string_view text) { step.reached(share_of_poses(text, photographs)); });
    step.done();
    return read_sparse_model(out.string());
}

/// The error for photographs that COLMAP cannot connect, with advice.
Error no_model(const Reconstruction& found,
               std::size_t photographs,
               const ReconstructOptions& options) {
    std::size_t features = 0;
    for (const auto& [name, count] : found.features) features += static_cast<std::size_t>(count);
    std::string tries;
    if (options.matcher != "exhaustive") tries = ", or try --matcher exhaustive";
    if (options.longest_side > options.feature_size)
        tries += str(tries.empty() ? ", or try" : " and", " --feature-size ", options.longest_side);
    return input_error(
        "COLMAP ", found.colmap, " found no camera positions for the ", photographs, " photographs",
        features > 0 ? str(" (", grouped(features / photographs), " features each)") : "",
        ": no three share enough of the scene from different places; take sharp photographs of "
        "something with texture, each sharing two thirds with the next, and step sideways between "
        "them",
        tries);
}

}  // namespace

Reconstruction reconstruct(const std::string& program,
                           const fs::path& work,
                           const fs::path& images,
                           const std::string& log,
                           const std::vector<CameraGroup>& groups,
                           const ReconstructOptions& options) {
    Colmap colmap(program, work, log);
    spdlog::info("COLMAP {}, on the CPU", colmap.version());
    if (options.longest_side > options.feature_size)
        spdlog::info(
            "Features are searched at {} of {} pixels (longest side), which is faster; "
            "--feature-size changes it",
            grouped(options.feature_size), grouped(options.longest_side));
    const bool with_poses = !options.poses.empty(),
               with_lens = !with_poses && !options.calibration.has_value();
    Reconstruction found;
    found.colmap = colmap.version();
    std::size_t photographs = 0;
    for (const CameraGroup& group : groups) photographs += group.names.size();
    // Checks the poses, and the options of all commands, before features and matches, which take
    // hours.
    if (with_poses) take_poses(colmap, work / "given", images, options);
    const std::vector<Words> matching = match_commands(colmap, work, photographs, options);
    const Words mapping = with_poses ? triangulate_command(colmap, work, images, options)
                                     : map_command(colmap, work, images, options),
                lens = with_lens ? lens_command(colmap, work) : Words();
    extract_features(colmap, work, images, groups, options, found.features);
    match(colmap, matching);
    if (with_poses)
        found.models.push_back(triangulate(colmap, work, mapping, photographs));
    else
        found.models = map_all(colmap, work, mapping, photographs);
    if (found.models.empty()) throw no_model(found, photographs, options);
    if (with_poses && found.models.front().points.empty())
        throw input_error(
            options.poses,
            ": no point of the photographs agrees with these poses; expected COLMAP's "
            "camera_from_world, x right, y down, z forward");
    if (with_lens)
        found.models[0] =
            with_lenses(colmap, work, lens, std::move(found.models[0]), groups, options);
    return found;
}

}  // namespace tvsgs::prepare
