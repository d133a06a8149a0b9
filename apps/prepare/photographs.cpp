#include "apps/prepare/photographs.h"

#include <algorithm>
#include <filesystem>
#include <map>
#include <set>

#include "apps/prepare/opencv.h"
#include "core/log.h"
#include "core/lower_case.h"
#include "io/files/read_file.h"
#include "io/images/image_file.h"
#include "io/scene/colmap.h"
#include "pipeline/run/signals.h"

namespace tvsgs::prepare {
namespace {

namespace fs = std::filesystem;

std::string lower_extension(const fs::path& path) {
    return lower_case(path.extension().string());
}

bool is_one_of(const std::string& extension, std::initializer_list<const char*> known) {
    return std::ranges::find(known, extension) != known.end();
}

/// Formats that Debian's COLMAP or training does not read.
bool needs_converting(const std::string& extension) {
    return is_one_of(extension, {".tif", ".tiff", ".webp"});
}

constexpr std::size_t kExifBytes = 1 << 17;  // its segments come first

void read_camera_data(Photograph& photo) {
    const Exif exif = read_exif(std::string_view(read_bytes(photo.file)).substr(0, kExifBytes));
    if (!exif.camera.empty() || exif.focal_mm != 0)
        photo.camera = str(exif.camera, " at ", exif.focal_mm, " mm");
    photo.place = exif.place;
}

}  // namespace

std::vector<Photograph> find_photographs(const std::string& folder) {
    std::vector<Photograph> photographs;
    std::vector<std::string> unreadable;
    for (fs::recursive_directory_iterator
             it(folder, fs::directory_options::follow_directory_symlink),
         end;
         it != end; ++it) {
        const fs::directory_entry& entry = *it;
        if (entry.path().filename().string().starts_with(".")) {  // thumbnails and deleted files
            it.disable_recursion_pending();
            continue;
        }
        const std::string extension = lower_extension(entry.path());
        if (!entry.is_regular_file()) continue;
        if (is_one_of(extension,
                      {".heic", ".heif", ".avif", ".cr2", ".cr3", ".nef", ".arw", ".dng"}))
            unreadable.push_back(entry.path().string());
        if (!has_image_extension(entry.path().string()) && !needs_converting(extension)) continue;
        Photograph photo;
        photo.file = entry.path().string();
        photo.name = entry.path().lexically_relative(folder).generic_string();
        photo.convert = needs_converting(extension);
        photographs.push_back(photo);
    }
    if (!unreadable.empty())
        spdlog::warn(
            "Skipped {} files, such as {}: not JPEG, PNG, TIFF or WebP; export them as JPEG",
            unreadable.size(), unreadable.front());
    std::ranges::sort(photographs, {}, &Photograph::name);
    if (photographs.size() < 2)
        throw input_error(folder, ": ", photographs.size(),
                          " photographs (.jpg, .jpeg, .png, .tif, .webp, .bmp, also in folders "
                          "below); expected at least 2");
    std::set<std::string> taken;
    for (const Photograph& photo : photographs)
        if (!photo.convert) taken.insert(photo.name);
    for (Photograph& photo : photographs) {
        if (photo.convert) {
            const std::string full = photo.name;
            photo.name = fs::path(full).replace_extension(".png").generic_string();
            if (!taken.insert(photo.name).second) taken.insert(photo.name = full + ".png");
        }
        const std::string extension = lower_extension(photo.file);
        if (is_one_of(extension, {".tif", ".tiff"})) {
            read_size(photo.file, photo.width, photo.height);
        } else {
            const ImageSize size = read_image_size(photo.file);
            photo.width = size.width, photo.height = size.height;
            read_camera_data(photo);
        }
    }
    return photographs;
}

bool is_video(const std::string& file) {
    return is_one_of(lower_extension(file),
                     {".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".mts"});
}

std::vector<CameraGroup> group_by_camera(const std::vector<Photograph>& photographs,
                                         Sharing sharing) {
    std::map<std::string, CameraGroup> groups;
    for (const Photograph& photo : photographs) {
        const std::string size = str(photo.width, "x", photo.height);
        const std::string camera = photo.camera.empty() ? size : str(size, ", ", photo.camera);
        CameraGroup& group = groups[sharing == Sharing::one    ? size
                                    : sharing == Sharing::each ? photo.name
                                                               : camera];
        group.description = camera;
        group.names.push_back(photo.name);
    }
    if (sharing == Sharing::one && groups.size() > 1)
        throw input_error("--cameras one: the photographs have ", groups.size(), " sizes, such as ",
                          groups.begin()->first, " and ", groups.rbegin()->first,
                          "; expected one size, or --cameras auto");
    std::vector<CameraGroup> out;
    for (auto& [key, group] : groups) out.push_back(std::move(group));
    return out;
}

void put_photographs(const std::vector<Photograph>& photographs, const std::string& folder) {
    for (const Photograph& photo : photographs) {
        SignalGuard::check();
        const fs::path to = fs::path(folder) / photo.name;
        fs::create_directories(to.parent_path());
        if (!photo.convert)
            fs::copy_file(photo.file, to);
        else if (lower_extension(photo.file) == ".webp")
            write_png(to.string(), read_image(photo.file));
        else
            convert_to_png(photo.file, to.string());
    }
}

std::string find_model_of(const std::string& folder) {
    const fs::path photos = fs::absolute(folder).lexically_normal();
    const fs::path above =
        photos.has_filename() ? photos.parent_path() : photos.parent_path().parent_path();
    for (const fs::path& scene : {photos, above}) {
        for (const char* model : {"sparse/0", "sparse", "colmap/sparse/0"})
            if (missing_colmap_files((scene / model).string()).empty())
                return (scene / model).string();
        for (const char* file : {"transforms.json", "transforms_train.json", "cameras_sphere.npz"})
            if (fs::exists(scene / file)) return (scene / file).string();
    }
    return "";
}

}  // namespace tvsgs::prepare
