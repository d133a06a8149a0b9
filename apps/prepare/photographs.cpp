#include "apps/prepare/photographs.h"

#include <filesystem>
#include <map>
#include <set>

#include "apps/prepare/opencv.h"
#include "io/files/read_file.h"
#include "pipeline/run/signals.h"

namespace tvsgs::prepare {
namespace {

namespace fs = std::filesystem;

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
    for (const std::string& name : photo_files(folder)) {
        Photograph photo;
        photo.file = (fs::path(folder) / name).string(), photo.name = name;
        photo.convert = needs_converting(lower_extension(name));
        photographs.push_back(photo);
    }
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

}  // namespace tvsgs::prepare
