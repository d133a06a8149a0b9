#include <algorithm>
#include <filesystem>

#include "apps/prepare/photographs.h"
#include "core/log.h"
#include "io/files/read_file.h"
#include "io/images/image_file.h"
#include "io/scene/colmap.h"

namespace tvsgs::prepare {

namespace fs = std::filesystem;

std::string lower_extension(const std::string& file) {
    return lower_case(fs::path(file).extension().string());
}

bool is_one_of(const std::string& extension, std::initializer_list<const char*> known) {
    return std::ranges::find(known, extension) != known.end();
}

bool needs_converting(const std::string& extension) {
    return is_one_of(extension, {".tif", ".tiff", ".webp"});
}

std::vector<std::string> photo_files(const std::string& folder) {
    std::vector<std::string> names, unreadable;
    for (fs::recursive_directory_iterator
             it(folder, fs::directory_options::follow_directory_symlink),
         end;
         it != end; ++it) {
        const fs::directory_entry& entry = *it;
        if (entry.path().filename().string().starts_with(".")) {  // thumbnails and deleted files
            it.disable_recursion_pending();
            continue;
        }
        if (!entry.is_regular_file()) continue;
        const std::string file = entry.path().string(), extension = lower_extension(file);
        if (is_one_of(extension,
                      {".heic", ".heif", ".avif", ".cr2", ".cr3", ".nef", ".arw", ".dng"}))
            unreadable.push_back(file);
        if (has_image_extension(file) || needs_converting(extension))
            names.push_back(entry.path().lexically_relative(folder).generic_string());
    }
    if (!unreadable.empty())
        spdlog::warn(
            "Skipped {} files, such as {}: not JPEG, PNG, TIFF or WebP; export them as JPEG",
            unreadable.size(), unreadable.front());
    if (names.size() < 2)
        throw input_error(folder, ": ", names.size(),
                          " photographs (.jpg, .jpeg, .png, .tif, .webp, .bmp, also in folders "
                          "below); expected at least 2");
    std::ranges::sort(names);
    return names;
}

bool is_video(const std::string& file) {
    return is_one_of(lower_extension(file),
                     {".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".mts"});
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
