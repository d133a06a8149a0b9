#include "apps/prepare/reconstruct.h"

#include <algorithm>
#include <optional>
#include <set>

#include "apps/prepare/run_program.h"
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
    explicit Step(std::string what) : what_(std::move(what)) {}
    void reached(std::size_t count, std::size_t all) {
        if (!progress_ || all != all_)
            progress_.emplace(what_, static_cast<double>(all)), done_ = 0;
        all_ = all;
        if (count > done_) progress_->advance(static_cast<double>(count - done_));
        done_ = std::max(done_, count);
    }
    void done() {
        progress_.reset();
        spdlog::info("{}: {:.0f} s", what_, steady_seconds() - begin_);
    }

private:
    std::string what_;
    std::optional<Progress> progress_;
    std::size_t done_ = 0, all_ = 0;
    double begin_ = steady_seconds();
};

/// The number after `before` in a line of COLMAP.
std::optional<std::size_t> number_after(std::string_view line, std::string_view before) {
    const std::size_t at = line.find(before);
    if (at == std::string_view::npos) return std::nullopt;
    line.remove_prefix(at + before.size());
    line = trimmed(line);
    std::size_t number = 0;
    return parse_number(line.substr(0, line.find_first_not_of("0123456789")), number)
               ? std::optional(number)
               : std::nullopt;
}

class Colmap {
public:
    Colmap(std::string program, std::string log, int threads)
        : program_(std::move(program)), log_(std::move(log)), threads_(threads) {}

    /// `threads_of`: option group of the number of threads; empty: none.
    template <class OnLine>
    int run(std::vector<std::string> words, const std::string& threads_of, OnLine&& on_line) const {
        words.insert(words.begin(), program_);
        if (threads_ > 0 && !threads_of.empty())
            words.insert(words.end(), {"--" + threads_of + ".num_threads", str(threads_)});
        return run_program(words, log_, on_line);
    }
    Error failed(const std::string& command, int code) const {
        return Error(ExitCode::input, str("colmap ", command, " failed (exit code ", code,
                                          "); last lines of ", log_, ":", last_lines(log_, 6)));
    }

private:
    std::string program_, log_;
    int threads_;
};

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

void extract_features(const Colmap& colmap,
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
        std::vector<std::string> words = {"feature_extractor",
                                          "--database_path",
                                          (work / "database.db").string(),
                                          "--image_path",
                                          images.string(),
                                          "--image_list_path",
                                          list_file,
                                          "--ImageReader.camera_model",
                                          lens,
                                          "--ImageReader.single_camera",
                                          "1",
                                          "--SiftExtraction.use_gpu",
                                          "0",
                                          "--SiftExtraction.max_image_size",
                                          str(options.max_size)};
        if (options.calibration) {
            std::string params;
            for (const double p : options.calibration->params)
                params += fmt::format("{}{:.17g}", params.empty() ? "" : ",", p);
            words.insert(words.end(), {"--ImageReader.camera_params", params});
        }
        std::string name;
        const int code = colmap.run(words, "SiftExtraction", [&](std::string_view line) {
            const std::string_view text = trimmed(line);
            if (text.starts_with("Name:")) name = trimmed(text.substr(5));
            if (const auto count = number_after(text, "Features:"))
                features[name] = static_cast<int>(*count);
            if (text.starts_with("Processed file")) step.reached(++done, all);
        });
        if (code != 0) throw colmap.failed("feature_extractor", code);
        spdlog::info("camera {} for {} photographs of {}", wanted, group.names.size(),
                     group.description);
    }
    step.done();
}

void match(const Colmap& colmap, const fs::path& work, const std::string& matcher) {
    Step step(matcher + " matching");
    const std::vector<std::string> words = {matcher + "_matcher", "--database_path",
                                            (work / "database.db").string(),
                                            "--SiftMatching.use_gpu", "0"};
    const int code = colmap.run(words, "SiftMatching", [&](std::string_view line) {
        // "Matching block [2/3, 1/3]", "Matching image [5/24]"
        const auto count = number_after(line, "Matching image ["),
                   block = number_after(line, "Matching block [");
        const auto all = number_after(line, "/");
        if (all && (count || block)) step.reached(count ? *count : *block, *all);
    });
    if (code != 0) throw colmap.failed(words[0], code);
    step.done();
}

/// Estimates poses, points and lenses; one model for each connected set of photographs.
std::vector<SparseModel> map_all(const Colmap& colmap,
                                 const fs::path& work,
                                 const fs::path& images,
                                 std::size_t photographs,
                                 bool lens_is_known) {
    Step step("poses");
    const fs::path out = work / "models";
    fs::create_directories(out);
    std::vector<std::string> words = {
        "mapper",       "--database_path",         (work / "database.db").string(),
        "--image_path", images.string(),           "--output_path",
        out.string(),   "--Mapper.min_model_size", "3"};
    if (lens_is_known)
        words.insert(words.end(), {"--Mapper.ba_refine_focal_length", "0",
                                   "--Mapper.ba_refine_extra_params", "0"});
    const int code = colmap.run(words, "Mapper", [&](std::string_view line) {
        // "Registering image #6 (3)": the third.
        if (line.starts_with("Registering image"))
            if (const auto count = number_after(line, "(")) step.reached(*count, photographs);
    });
    std::vector<SparseModel> models;
    for (const auto& entry : fs::directory_iterator(out))
        if (count_images(entry.path().string()) > 0)
            models.push_back(read_sparse_model(entry.path().string()));
    constexpr int kNoModel = 1;  // exit code if no pair starts a model
    if (code > kNoModel || (code != 0 && !models.empty())) throw colmap.failed("mapper", code);
    std::ranges::sort(models, [](const SparseModel& a, const SparseModel& b) {
        return std::pair(a.images.size(), a.points.size()) >
               std::pair(b.images.size(), b.points.size());
    });
    step.done();
    return models;
}

/// Refines a model with the final lenses, and with the principal point of cameras with enough
/// photographs to separate it from the poses.
SparseModel with_lenses(const Colmap& colmap,
                        const fs::path& work,
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
    const fs::path found = work / "found", out = work / "refined";
    fs::create_directories(out);
    write_sparse_model(found.string(), model);
    const int code =
        colmap.run({"bundle_adjuster", "--input_path", found.string(), "--output_path",
                    out.string(), "--BundleAdjustment.refine_principal_point", centres ? "1" : "0"},
                   "", [](std::string_view) {});
    if (code != 0) throw colmap.failed("bundle_adjuster", code);
    step.done();
    return read_sparse_model(out.string());
}

/// Writes the poses of the model in `options.poses` for these photographs to the folder `given`.
void take_poses(const Colmap& colmap,
                const fs::path& given,
                const fs::path& images,
                const ReconstructOptions& options) {
    fs::create_directories(given);
    const int code = colmap.run({"model_converter", "--input_path", options.poses, "--output_path",
                                 given.string(), "--output_type", "BIN"},
                                "", [](std::string_view) {});
    if (code != 0) throw colmap.failed("model_converter", code);
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
    for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) fs::remove(given / name);
    write_sparse_model(given.string(), model);
}

/// Triangulates points for the poses in `given`.
SparseModel triangulate(const Colmap& colmap,
                        const fs::path& work,
                        const fs::path& images,
                        const fs::path& given) {
    Step step("points for the given poses");
    const fs::path out = work / "models/0";
    fs::create_directories(out);
    const int code =
        colmap.run({"point_triangulator", "--database_path", (work / "database.db").string(),
                    "--image_path", images.string(), "--input_path", given.string(),
                    "--output_path", out.string(), "--clear_points", "1"},
                   "Mapper", [](std::string_view) {});
    if (code != 0) throw colmap.failed("point_triangulator", code);
    step.done();
    return read_sparse_model(out.string());
}

}  // namespace

std::string find_colmap() {
    const std::string file = find_program("colmap");
    if (file.empty())
        throw Error(ExitCode::usage,
                    "COLMAP not found; install it (apt-get install colmap) or put it on the PATH");
    return file;
}

Reconstruction reconstruct(const std::string& program,
                           const fs::path& work,
                           const fs::path& images,
                           const std::string& log,
                           const std::vector<CameraGroup>& groups,
                           const ReconstructOptions& options) {
    const Colmap colmap(program, log, options.threads);
    Reconstruction found;
    std::size_t photographs = 0;
    for (const CameraGroup& group : groups) photographs += group.names.size();
    const fs::path given = work / "given";
    // Checks them before features and matches, which take hours.
    if (!options.poses.empty()) take_poses(colmap, given, images, options);
    extract_features(colmap, work, images, groups, options, found.features);
    match(colmap, work, options.matcher);
    if (!options.poses.empty())
        found.models.push_back(triangulate(colmap, work, images, given));
    else
        found.models = map_all(colmap, work, images, photographs, options.calibration.has_value());
    if (options.poses.empty() && !options.calibration && !found.models.empty())
        found.models[0] = with_lenses(colmap, work, std::move(found.models[0]), groups, options);
    if (found.models.empty())
        throw input_error("COLMAP found no camera positions for the ", photographs,
                          " photographs: no three share enough of the scene from different places; "
                          "take sharp photographs of something with texture, each sharing two "
                          "thirds with the next, and step sideways between them");
    return found;
}

}  // namespace tvsgs::prepare
