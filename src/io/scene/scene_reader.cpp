#include "io/scene/scene_reader.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <set>
#include <tuple>

#include "core/device/buffer.h"
#include "core/device/parallel_lists.h"
#include "core/grouped.h"
#include "core/log.h"
#include "core/math/quantile.h"
#include "io/files/read_file.h"
#include "io/images/image_file.h"
#include "io/scene/colmap.h"
#include "io/scene/load_views.h"
#include "io/splats/ply.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

/// Finds the file of an image: the listed name, else another extension, else the base name if
/// unique.
class ImageFinder {
public:
    ImageFinder(const fs::path& folder, const ColmapModel& model) : folder_(folder) {
        for (const auto& image : model.images) ++uses_[fs::path(image.name).stem().string()];
    }
    std::optional<std::string> find(const std::string& name) const {
        if (auto found = find_with_extensions(folder_ / name)) return found;
        const fs::path base = fs::path(name).filename();
        if (uses_.at(base.stem().string()) == 1) return find_with_extensions(folder_ / base);
        return std::nullopt;
    }

private:
    static std::optional<std::string> find_with_extensions(const fs::path& path) {
        if (is_file(path) && has_image_extension(path.string())) return path.string();
        for (std::string extension : kImageExtensions)
            for (const bool upper : {false, true}) {
                if (upper)
                    std::transform(
                        extension.begin(), extension.end(), extension.begin(),
                        [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
                const fs::path other = fs::path(path).replace_extension(extension);
                if (is_file(other)) return other.string();
            }
        // Keeps formats such as TIFF, folders, pipes and loops: reading them reports what to do.
        std::error_code code;
        const bool is_there = fs::status(path, code).type() != fs::file_type::not_found;
        return is_there ? std::optional(path.string()) : std::nullopt;
    }
    fs::path folder_;
    std::map<std::string, int> uses_;
};

/// Runs `action`. Names the scene in errors; turns those of the file system into wrong input.
template <class Action>
auto reading_scene(const SceneOptions& options, const Action& action) {
    return with_context(str("reading scene ", options.path), [&] {
        try {
            return action();
        } catch (const fs::filesystem_error& error) {  // such as a link to itself
            throw input_error(error.path1().string(), ": ", error.code().message());
        }
    });
}

/// Finds the mask of an image: same path, else the same name or number (DTU: 000.png belongs to
/// 000000.jpg) in a folder of the same path, or anywhere if no other image has it.
class MaskFinder {
public:
    MaskFinder(const SceneOptions& options, const std::vector<ColmapImage>& images) {
        const fs::path scene(options.path);
        if (!options.masks.empty()) {
            required_ = true;
            folder_ = fs::is_directory(scene / options.masks) ? scene / options.masks
                                                              : fs::path(options.masks);
            if (!fs::is_directory(folder_))
                throw input_error("E_MASKS: ", options.masks,
                                  ": folder not found, neither in the scene nor here");
        } else {
            for (const char* name : {"mask", "masks"})
                if (folder_.empty() && fs::is_directory(scene / name)) folder_ = scene / name;
        }
        if (folder_.empty()) return;
        std::vector<fs::path> files;
        for (const auto& entry : fs::recursive_directory_iterator(folder_))
            if (entry.is_regular_file()) files.push_back(entry.path().lexically_relative(folder_));
        std::ranges::sort(files);
        // Annotations may have the names of the masks.
        std::ranges::stable_partition(
            files, [](const fs::path& file) { return has_image_extension(file.string()); });
        for (const fs::path& file : files) {
            const std::string stem = fs::path(file).replace_extension().string();
            int number = 0;
            if (by_stem_.emplace(stem, file).second && parse_number(file.stem().string(), number)) {
                const auto [entry, is_new] = by_number_.emplace(number, file);
                if (!is_new) entry->second.clear();  // ambiguous
            }
        }
        for (const ColmapImage& image : images) {
            const std::string stem = fs::path(image.name).stem().string();
            int number = 0;
            ++images_by_stem_[stem];
            if (parse_number(stem, number)) ++images_by_number_[number];
        }
    }
    /// Warns once of a mask outside of folders that several images have the name of.
    std::optional<std::string> find(const std::string& name) {
        if (folder_.empty()) return std::nullopt;
        const fs::path path(name);
        const std::string own = path.stem().string();
        for (const std::string& stem : {fs::path(path).replace_extension().string(), name})
            if (const auto found = by_stem_.find(stem); found != by_stem_.end())
                return (folder_ / found->second).string();
        if (const auto found = by_stem_.find(own);
            found != by_stem_.end() && images_by_stem_.at(own) == 1)
            return (folder_ / found->second).string();
        int number = 0;
        if (parse_number(own, number))
            if (const auto found = by_number_.find(number);
                found != by_number_.end() && !found->second.empty() &&
                (images_by_number_.at(number) == 1 ||
                 found->second.parent_path() == path.parent_path()))
                return (folder_ / found->second).string();
        if (const auto found = by_stem_.find(own); found != by_stem_.end() && !warned_) {
            warned_ = true;
            spdlog::warn(
                "{}: may belong to several images, such as {}, and is not used; put the "
                "masks into folders like the images",
                (folder_ / found->second).string(), name);
        }
        if (required_)
            throw input_error("E_MASKS: ", folder_.string(), ": no mask for image '", name, "'");
        return std::nullopt;
    }

private:
    fs::path folder_;
    bool required_ = false, warned_ = false;
    std::map<std::string, fs::path> by_stem_;
    std::map<int, fs::path> by_number_;
    std::map<std::string, int> images_by_stem_;
    std::map<int, int> images_by_number_;
};

/// Reads the initial points. Also sets View::pose_error_px.
PointCloud initial_points(const SceneOptions& options,
                          const SceneLayout& layout,
                          const std::vector<ViewSource>& train,
                          Vec3d origin,
                          std::vector<View>& views) {
    const std::string& model_folder = layout.source;
    const ColmapModel& model = layout.model;
    const auto from_ply = [origin](const std::string& path) {
        PointCloud cloud = read_ply(path, origin).points;
        drop_invalid_points(cloud, path);
        return cloud;
    };
    if (!options.init_ply.empty()) {
        PointCloud cloud = from_ply(options.init_ply);
        if (cloud.positions.empty())
            throw input_error("E_NO_POINTS: ", options.init_ply, ": no usable points");
        return cloud;
    }

    // A cloud beside the model does not tell which images it comes from. A subset cannot use it,
    // because information from test views would leak in.
    const bool subset = train.size() < model.images.size();
    const bool colmap = layout.format == "colmap";
    const std::string fused = (fs::path(options.path) / "dense/fused.ply").string();
    if (!subset && is_file(fused)) return from_ply(fused);

    const ColmapPoints points = colmap ? read_colmap_points(model_folder) : ColmapPoints{};
    if (colmap) measure_pose_errors(points, train, views);
    std::set<std::uint32_t> train_ids;
    for (const auto& view : train) train_ids.insert(view.image->id);
    PointCloud cloud;
    for (std::size_t i = 0; i < points.positions.size(); ++i) {
        if (subset) {
            std::set<std::uint32_t> seen_by;  // a track may list an image twice
            for (std::size_t j = points.track_begin[i]; j < points.track_begin[i + 1]; ++j)
                if (train_ids.contains(points.track[j])) seen_by.insert(points.track[j]);
            if (seen_by.size() < 2) continue;
        }
        cloud.positions.push_back(vec_cast<float>(points.positions[i] - origin));
        cloud.colors.push_back(points.colors[i]);
    }
    if (subset && !points.positions.empty())
        spdlog::debug("{} of the model's {} points are seen by two training views",
                      cloud.positions.size(), points.positions.size());
    drop_invalid_points(cloud, model_folder);
    // The points of Blender scenes do not come from photographs.
    const bool may_use = !subset || layout.format == "blender";
    const std::string ply =
        colmap ? (fs::path(model_folder) / "points3D.ply").string() : layout.points;
    if (cloud.positions.empty() && may_use && is_file(ply)) cloud = from_ply(ply);
    if (cloud.positions.empty() && options.points_required)
        throw input_error("E_NO_POINTS: ", model_folder, ": no start points",
                          subset ? str(" (", grouped(points.positions.size()),
                                       " in the scene, none seen by two of the ", train.size(),
                                       " training views)")
                                 : "",
                          "; give a cloud with --init-ply, for example from tvsgs-init");
    return cloud;
}

/// Uses all images of the model, so that the frame does not depend on the split.
Vec3d origin_of(const ColmapModel& model) {
    std::vector<Vec3d> centres;
    for (const ColmapImage& image : model.images)
        centres.push_back(inverse(image.camera_from_world).t);
    return local_origin(centres);
}

/// Some programs turn the pixels and leave the EXIF orientation as it was. Then the upward axes of
/// the cameras agree only as the photographs are stored.
void drop_wrong_turns(Scene& scene) {
    Vec3d stored, turned;
    double count = 0;
    bool any = false;
    for (const std::vector<View>* views : {&scene.train, &scene.test})
        for (const View& view : *views) {
            const auto down = [](const Camera& camera) {
                const float* const row = camera.camera_from_world.R[1];
                return Vec3d{row[0], row[1], row[2]};
            };
            stored += down(view.camera);
            turned += down(turned_camera(view.camera, view.upright_turns));
            ++count, any = any || view.upright_turns != 0;
        }
    // Level cameras add up to their count; directions at random stay far below half of it.
    if (!any || !(norm(stored) > std::max(0.5 * count, 1.5 * norm(turned)))) return;
    for (std::vector<View>* views : {&scene.train, &scene.test})
        for (View& view : *views) view.upright_turns = 0;
    spdlog::info("{}: the EXIF orientations contradict the cameras and are ignored", scene.path);
}

}  // namespace

std::size_t drop_invalid_points(PointCloud& cloud, const std::string& source) {
    const std::vector<Vec3f>& p = cloud.positions;
    const auto is_finite_here = [&](std::size_t i) {
        return std::abs(p[i].x) <= 1e9f && std::abs(p[i].y) <= 1e9f && std::abs(p[i].z) <= 1e9f;
    };
    std::vector<int> order = indices_where(p.size(), is_finite_here);
    const std::size_t not_finite = p.size() - order.size();
    const auto place = [&](int i) {
        const Vec3f at = p[i];
        return std::tuple(at.x, at.y, at.z);
    };
    sort_in_parallel(
        order, [&](int a, int b) { return std::tuple(place(a), a) < std::tuple(place(b), b); });
    std::vector<char> keep(p.size());
    parallel_for(Cpu{}, static_cast<int>(order.size()), [&](std::size_t at) {
        keep[static_cast<std::size_t>(order[at])] =
            at == 0 || place(order[at - 1]) != place(order[at]);
    });
    const std::vector<int> kept =
        indices_where(p.size(), [&](std::size_t i) { return keep[i] != 0; });
    const std::size_t repeated = order.size() - kept.size();
    if (not_finite > 0)
        spdlog::warn("{}: dropped {} points: positions not finite or beyond 1e9", source,
                     grouped(not_finite));
    // SIFT finds some places in two orientations.
    if (repeated > 0)
        spdlog::log(2 * repeated > order.size() ? spdlog::level::warn : spdlog::level::debug,
                    "{}: dropped {} points: repeated positions", source, grouped(repeated));
    if (not_finite + repeated == 0) return 0;
    const auto compact = [&](auto& values) {
        if (!values.empty()) values = taken(values, kept);
    };
    compact(cloud.positions), compact(cloud.colors), compact(cloud.normals);
    compact(cloud.confidences);
    return not_finite + repeated;
}

float scene_extent(const Scene& scene) {
    if (scene.train.empty()) return 1;
    Vec3d mean;
    for (const View& view : scene.train) mean += vec_cast<double>(camera_centre(view.camera));
    mean = mean / static_cast<double>(scene.train.size());
    double radius = 0;
    for (const View& view : scene.train)
        radius = std::max(radius, norm(vec_cast<double>(camera_centre(view.camera)) - mean));
    if (1.1 * radius >= 1e-9) return static_cast<float>(1.1 * radius);

    std::vector<float> distances;
    for (const Vec3f p : scene.points.positions)
        distances.push_back(norm(p - camera_centre(scene.train[0].camera)));
    if (distances.empty()) return 1;
    const float median = middle_of(distances);
    spdlog::warn(
        "{}: all training cameras are at one place; the scene extent is the median distance of the "
        "points, {}",
        scene.path, median);
    return median;
}

PixelSize resized_size(int resolution, int width, int height) {
    const double w = width, h = height;
    const auto size = [](double x, double y) {
        return PixelSize{std::max(1, static_cast<int>(x)), std::max(1, static_cast<int>(y))};
    };
    if (resolution == 1 || resolution == 2 || resolution == 4 || resolution == 8)
        return size(std::nearbyint(w / resolution),
                    std::nearbyint(h / resolution));  // half to even
    if (resolution == -1) {
        if (width <= 1600) return {width, height};
        const double scale = w / 1600.0;
        return size(w / scale, h / scale);
    }
    if (resolution < 1 || resolution > 65535)
        throw Error(ExitCode::usage, "--resolution ", resolution,
                    ": expected -1, 1, 2, 4, 8 or a width in pixels");
    // Same order of operations as in the official codes; it can lose a pixel.
    const double scale = w / resolution;
    return size(w / scale, h / scale);
}

Vec3d read_scene_origin(const SceneOptions& options) {
    return reading_scene(options, [&] { return origin_of(read_layout(options).model); });
}

ChosenViews choose_views(const SceneOptions& options) {
    return reading_scene(options, [&] {
        SceneLayout layout = read_layout(options);
        const ColmapModel& model = layout.model;
        resized_size(options.resolution, 1, 1);  // reports a wrong value before loading

        const fs::path image_folder = layout.images;
        const ImageFinder image_finder(image_folder, model);
        std::vector<std::string> names;
        std::vector<std::optional<std::string>> files;
        std::vector<bool> exists;
        constexpr std::size_t kShown = 3;
        std::size_t missing = 0;
        std::string lost;  // names of missing images
        for (const ColmapImage& image : model.images) {
            names.push_back(image.name);
            files.push_back(image_finder.find(image.name));
            exists.push_back(files.back().has_value());
            if (!files.back() && ++missing <= kShown)
                lost += (missing > 1 ? ", " : "") + image.name;
        }
        if (missing > kShown) lost += ", ...";
        if (missing == names.size())
            throw input_error("E_NO_IMAGES: ", image_folder.string(), ": ",
                              fs::is_directory(image_folder) ? "none of" : "folder not found for",
                              " the ", names.size(), " images of the scene",
                              str(fs::is_directory(image_folder) ? " is there" : "", ", such as '",
                                  names[0], "'"),
                              "; give their folder with --images");
        if (missing > 0)
            spdlog::warn("{}: not found, skipped: {} ({} of {})", image_folder.string(), lost,
                         missing, names.size());
        ViewSplit split = split_views(options, names, exists, layout.train, layout.test);
        return ChosenViews{std::move(layout), std::move(files), std::move(split)};
    });
}

PhotoStorage photo_storage(const ChosenViews& chosen, const SceneOptions& options) {
    constexpr std::int64_t kShareOfMemory = 4;
    // Bytes per pixel: colours, mask if any, and the finer grey pixels.
    const double finer = 1 / static_cast<double>(options.grey_scale),
                 per_pixel = 3 + 1 + (options.grey_scale < 1 ? finer * finer : 0);
    double bytes = 0;
    for (const auto* indices : {&chosen.split.train, &chosen.split.test})
        for (const int i : *indices) {
            const ColmapModel& model = chosen.layout.model;
            const Intrinsics& in = model.cameras.at(model.images[i].camera_id);
            const PixelSize size = resized_size(options.resolution, static_cast<int>(in.width_px),
                                                static_cast<int>(in.height_px));
            bytes += per_pixel * size.width_px * size.height_px;
        }
    PhotoStorage storage;
    storage.bytes = std::llround(bytes);
    storage.limit =
        options.photo_memory > 0 ? options.photo_memory : free_host_bytes() / kShareOfMemory;
    storage.in_file = options.photos == PhotoPlace::file ||
                      (options.photos == PhotoPlace::automatic && storage.bytes > storage.limit);
    return storage;
}

std::string PhotoStorage::reason() const {
    return fmt::format("photographs and masks: {:.3g} {} {:.3g} GB, a quarter of the memory",
                       static_cast<double>(bytes) / 1e9,
                       bytes > limit ? ">" : "<=", static_cast<double>(limit) / 1e9);
}

Scene load_scene(const ChosenViews& chosen, const SceneOptions& options) {
    return reading_scene(options, [&] {
        const SceneLayout& layout = chosen.layout;
        const ColmapModel& model = layout.model;

        // 1. Views.
        MaskFinder mask_finder(options, model.images);
        const auto sources = [&](const std::vector<int>& indices) {
            std::vector<ViewSource> out;
            for (const int i : indices) {
                const ColmapImage& image = model.images[i];
                const Intrinsics& intrinsics = model.cameras.at(image.camera_id);
                const auto mask = layout.masks.find(image.name);
                out.push_back({&image, intrinsics, *chosen.files[i],
                               mask != layout.masks.end() && options.masks.empty()
                                   ? mask->second
                                   : mask_finder.find(image.name),
                               layout.alpha_on_black});
            }
            return out;
        };
        const std::vector<ViewSource> train = sources(chosen.split.train);
        Scene scene;
        scene.path = options.path;
        scene.origin = origin_of(model);
        if (norm(scene.origin) > 0)
            spdlog::info(
                "{}: the cameras are far from zero; computes in a frame at ({}, {}, {}), files "
                "keep the coordinates of the scene",
                options.path, scene.origin.x, scene.origin.y, scene.origin.z);
        const PhotoStorage storage = photo_storage(chosen, options);
        std::optional<PixelFile> file;
        if (storage.in_file) {
            const std::string folder =
                options.photo_folder.empty() ? options.scratch : options.photo_folder;
            file.emplace(folder);
            spdlog::info(
                "Photographs are kept in a file in {}: {}", folder.empty() ? "." : folder,
                options.photos == PhotoPlace::file ? "scene.photos=file" : storage.reason());
        }
        PixelFile* const to = file ? &*file : nullptr;
        scene.train = load_views(train, options, scene.origin, to);
        log_undistortion(train);
        warn_of_empty_masks(train, scene.train);
        scene.test = load_views(sources(chosen.split.test), options, scene.origin, to);
        drop_wrong_turns(scene);
        double offset = 0;
        for (const ViewSource& view : train)
            offset =
                std::max({offset, std::abs(view.intrinsics.cx_px / view.intrinsics.width_px - 0.5),
                          std::abs(view.intrinsics.cy_px / view.intrinsics.height_px - 0.5)});
        if (offset > 0.01 && !options.center_principal_point)
            spdlog::info(
                "{}: the principal point is {:.1f} % off the image centre and used as given (the "
                "official codes assume the centre)",
                options.path, 100 * offset);

        // 2. Initial cloud.
        if (options.need_points)
            scene.points = initial_points(options, layout, train, scene.origin, scene.train);
        scene.extent = scene_extent(scene);
        return scene;
    });
}

Scene read_scene(const SceneOptions& options) {
    return load_scene(choose_views(options), options);
}

}  // namespace tvsgs
