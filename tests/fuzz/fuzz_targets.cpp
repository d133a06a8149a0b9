#include "fuzz_targets.h"

#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <stdexcept>

#include "core/error.h"
#include "core/log.h"
#include "io/config/config.h"
#include "io/files/checkpoint.h"
#include "io/files/json_value.h"
#include "io/files/npz.h"
#include "io/files/read_file.h"
#include "io/files/zip_archive.h"
#include "io/images/image_file.h"
#include "io/mesh/mesh_files.h"
#include "io/priors/prior_sources.h"
#include "io/scene/colmap.h"
#include "io/scene/control_list.h"
#include "io/scene/crop_file.h"
#include "io/scene/georeference.h"
#include "io/scene/scene_layout.h"
#include "io/scene/scene_reader.h"
#include "io/scene/trajectory.h"
#include "io/splats/ply.h"
#include "io/splats/splat_files.h"
#include "optim/loop/train.h"

namespace tvsgs::fuzz {
namespace {

namespace fs = std::filesystem;

void write(const std::string& path, std::string_view bytes) {
    std::ofstream(path, std::ios::binary) << bytes;
}

/// Writes a correct other file of the model, so that errors come only from the file under test.
void read_cameras(const std::string& folder, const std::string&) {
    write(folder + "/images.txt", "1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 1 0 0 1 b.png\n\n");
    read_colmap_model(folder);
}
void read_images(const std::string& folder, const std::string&) {
    write(folder + "/cameras.txt", "1 PINHOLE 64 48 60 60 32 24\n");
    read_colmap_model(folder);
}
void read_points(const std::string& folder, const std::string&) {
    read_colmap_points(folder);
}

void read_any_ply(const std::string&, const std::string& file) {
    const PlyContents contents = read_ply(file);
    for (const Vec3i& face : contents.faces)  // users of a mesh index with these
        for (int c = 0; c < 3; ++c) contents.points.positions.at(static_cast<std::size_t>(face[c]));
    read_ply_geometry(file);
}

void read_any_mesh(const std::string&, const std::string& file) {
    const PlyContents contents = read_mesh(file);
    for (const Vec3i& face : contents.faces)
        for (int c = 0; c < 3; ++c) contents.points.positions.at(static_cast<std::size_t>(face[c]));
    read_mesh_geometry(file);
}

void read_any_splat_glb(const std::string&, const std::string& file) {
    const std::string bytes = read_bytes(file);
    splat_glb_place(bytes, file);
    parse_splat_glb(bytes, file);
}

/// Corrects the lengths of the container, so that the reader goes on to its content.
std::string with_lengths(std::string bytes) {
    if (bytes.size() < 28) return bytes;
    const std::size_t bin = bytes.rfind(std::string_view("BIN\0", 4));
    const auto put = [&](std::size_t at, std::size_t value) {
        const auto number = static_cast<std::uint32_t>(value);
        std::memcpy(&bytes[at], &number, 4);
    };
    put(8, bytes.size());
    if (bin == std::string::npos || bin < 24) {
        put(12, bytes.size() - 20);
    } else {
        put(12, bin - 4 - 20);
        put(bin - 4, bytes.size() - bin - 4);
    }
    return bytes;
}

void read_layout_of(SceneFormat format, const std::string& folder) {
    SceneOptions options;
    options.path = folder;
    options.format = format;
    read_layout(options);
}

void read_mvsnet_cameras(const std::string& folder, const std::string&) {
    fs::create_directories(folder + "/images");
    if (!fs::exists(folder + "/images/00000000.png"))
        write_png(folder + "/images/00000000.png", ImageU8(8, 6, 3));
    read_layout_of(SceneFormat::mvsnet, folder);
}

void read_blender(const std::string& folder, const std::string&) {
    if (!fs::exists(folder + "/image.png")) write_png(folder + "/image.png", ImageU8(8, 6, 3));
    read_layout_of(SceneFormat::blender, folder);
}

void read_npz_cameras(const std::string& folder, const std::string&) {
    fs::create_directories(folder + "/image");
    for (const char* name : {"/image/000.png", "/image/001.png"})
        if (!fs::exists(folder + name)) write_png(folder + name, ImageU8(8, 6, 3));
    read_layout_of(SceneFormat::idr, folder);
}

void read_view_list(const std::string&, const std::string& file) {
    SceneOptions options;
    options.train_list = options.test_list = file;
    split_views(options, {"a/0.png", "b/0.png", "c d.png"}, {true, true, true});
}

void read_configuration(const std::string&, const std::string& file) {
    TrainOptions options;
    OptionTable table;
    table.add("", options);
    table.read_file(file);
    table.json();
}

/// Reads an array as depth, normals and descriptors.
void read_map_array(const std::string&, const std::string& file) {
    read_npy_map(file, 0);
    try {
        read_npy_map(file, 1);
    } catch (const Error&) {
        read_npy_map(file, 3);
    }
}

/// Reads priors.json beside files that it may describe.
void find_priors_in(const std::string& scene, std::initializer_list<const char*> files) {
    for (const char* name : files) {
        const fs::path path = fs::path(scene) / name;
        if (fs::exists(path)) continue;
        fs::create_directories(path.parent_path());
        write(path.string(), "");
    }
    find_priors({scene, "", {"0001.png", "a/0002.png"}});
}
void read_priors_file(const std::string& folder, const std::string&) {
    find_priors_in(
        folder, {"priors/depth/0001.npy", "priors/depth/0002.pfm", "priors/normal/0001.png",
                 "priors/confidence/0001.npy", "priors/features/0001.npy", "priors/sky/0001.png"});
}
void read_params(const std::string& folder, const std::string&) {
    find_priors_in(folder, {"depths/0001.png"});
}
void read_depth_paths(const std::string& folder, const std::string&) {
    find_priors_in(folder, {"d/0001.png", "d/0002.npy"});
}

/// Reads the header, and the pixels of small images.
void read_picture(const std::string&, const std::string& file) {
    const ImageSize size = read_image_size(file);
    if (std::int64_t{size.width} * size.height < 1 << 16) read_image(file);
}

/// Corrects the checksums of a checkpoint's table and arrays.
std::string with_checksums(std::string bytes) {
    constexpr std::size_t kFixed = 28, kTableBytesAt = 12, kFileBytesAt = 16, kArraysAt = 24;
    std::uint32_t table = 0, arrays = 0;
    if (bytes.size() < kFixed + 4) return bytes;
    std::memcpy(&table, &bytes[kTableBytesAt], 4);
    std::memcpy(&arrays, &bytes[kArraysAt], 4);
    if (table > bytes.size() - kFixed - 4) return bytes;
    const std::uint64_t size = bytes.size();
    std::memcpy(&bytes[kFileBytesAt], &size, 8);
    std::size_t entry = kFixed, data = kFixed + table + 4;
    for (std::uint32_t i = 0; i < arrays; ++i) {
        std::uint32_t name = 0;
        std::uint64_t count = 0;
        if (entry + 4 > kFixed + table) break;
        std::memcpy(&name, &bytes[entry], 4);
        const std::uint64_t end = entry + 4ull + name + 4 + 1 + 8 + 4;
        if (end > kFixed + table) break;
        std::memcpy(&count, &bytes[end - 12], 8);
        if (count > bytes.size() - data) break;
        const std::uint32_t sum = checksum(&bytes[0] + data, static_cast<std::size_t>(count));
        std::memcpy(&bytes[end - 4], &sum, 4);
        entry = end, data += static_cast<std::size_t>(count);
    }
    const std::uint32_t sum = checksum(bytes.data(), kFixed + table);
    std::memcpy(&bytes[kFixed + table], &sum, 4);
    return bytes;
}

/// Compresses the bytes with gzip.
std::string with_gzip(std::string bytes) {
    z_stream z{};
    if (deflateInit2(&z, 1, Z_DEFLATED, 16 + MAX_WBITS, 8, Z_DEFAULT_STRATEGY) != Z_OK)
        throw std::bad_alloc();
    std::string out(deflateBound(&z, static_cast<uLong>(bytes.size())), '\0');
    z.next_in = reinterpret_cast<Bytef*>(bytes.data());
    z.avail_in = static_cast<uInt>(bytes.size());
    z.next_out = reinterpret_cast<Bytef*>(out.data());
    z.avail_out = static_cast<uInt>(out.size());
    deflate(&z, Z_FINISH);
    out.resize(z.total_out);
    deflateEnd(&z);
    return out;
}

/// Puts meta.json into an archive with pictures that it may name.
std::string with_pictures(std::string bytes) {
    std::vector<std::pair<std::string, std::string>> files{{"meta.json", std::move(bytes)}};
    ImageU8 picture(64 * 3, 2, 4);
    for (std::size_t i = 0; i < picture.pixels.size(); ++i)
        picture.pixels[i] = static_cast<std::uint8_t>(i * 37);
    files.emplace_back("a.webp", webp_lossless_bytes(picture));
    return zip_bytes(files);
}

void complain(const std::string& what) {
    throw std::logic_error(what);
}

}  // namespace

const std::vector<Target>& targets() {
    using S = const std::string&;
    static std::vector<Target> all = {
        {"colmap_cameras_bin", "cameras.bin", read_cameras, nullptr},
        {"colmap_cameras_txt", "cameras.txt", read_cameras, nullptr},
        {"colmap_images_bin", "images.bin", read_images, nullptr},
        {"colmap_images_txt", "images.txt", read_images, nullptr},
        {"colmap_points_bin", "points3D.bin", read_points, nullptr},
        {"colmap_points_txt", "points3D.txt", read_points, nullptr},
        {"ply_splats", "a.ply", [](S, S file) { read_splat_ply(file); }, nullptr},
        {"ply_mesh", "a.ply", read_any_ply, nullptr},
        {"mesh_glb", "a.glb", read_any_mesh, with_lengths},
        {"mesh_obj", "a.obj", read_any_mesh, nullptr},
        {"spz", "a.spz", [](S, S file) { read_spz(file); }, with_gzip},
        {"splat_glb", "a.glb", read_any_splat_glb, with_lengths},
        {"npy", "a.npy", [](S, S file) { read_npy(file); }, nullptr},
        {"npz", "a.npz", [](S, S file) { read_npz(file); }, nullptr},
        {"npz_cameras", "cameras_sphere.npz", read_npz_cameras, nullptr},
        {"safetensors", "a.safetensors", [](S, S file) { read_tensors(file); }, nullptr},
        {"mat", "a.mat", [](S, S file) { read_mat_array(file, "ObsMask"); }, nullptr},
        {"tnt_log", "a.log", [](S, S file) { read_trajectory_log(file); }, nullptr},
        {"tnt_trans", "a.txt", [](S, S file) { read_transform(file); }, nullptr},
        {"control_list", "gcp_list.txt", [](S, S file) { read_control_list(file); }, nullptr},
        {"georeference", "georeference.json", [](S folder, S) { read_georeference(folder); },
         nullptr},
        {"crop", "a.json", [](S, S file) { read_crop(file); }, nullptr},
        {"nerfstudio", "transforms.json",
         [](S folder, S) { read_layout_of(SceneFormat::nerfstudio, folder); }, nullptr},
        {"blender", "transforms_train.json", read_blender, nullptr},
        {"mvsnet", "cams/00000000_cam.txt", read_mvsnet_cameras, nullptr},
        {"view_list", "list.txt", read_view_list, nullptr},
        {"lists", "splits.json", [](S, S file) { read_json_lists(file); }, nullptr},
        {"json", "report.json", [](S, S file) { parse_json_value(read_bytes(file), file); },
         nullptr},
        {"config", "config.json", read_configuration, nullptr},
        {"checkpoint", "a.ckpt", [](S, S file) { read_checkpoint(file); }, with_checksums},
        {"image", "a.png", read_picture, nullptr},
        {"exif", "a.jpg", [](S, S file) { read_exif(read_bytes(file)); }, nullptr},
        {"map_pfm", "a.pfm", [](S, S file) { read_pfm(file); }, nullptr},
        {"map_dmb", "a.dmb", [](S, S file) { read_dmb(file); }, nullptr},
        {"map_colmap", "a.bin", [](S, S file) { read_colmap_map(file); }, nullptr},
        {"map_npy", "a.npy", read_map_array, nullptr},
        {"priors", "priors/priors.json", read_priors_file, nullptr},
        {"depth_params", "sparse/0/depth_params.json", read_params, nullptr},
        {"depth_paths", "transforms.json", read_depth_paths, nullptr},
        {"sog", "a.sog", [](S, S file) { read_sog(file); }, with_pictures},
    };
    return all;
}

const Target& find_target(std::string_view name) {
    std::string known;
    for (const Target& target : targets()) {
        if (target.name == name) return target;
        known += str(" ", target.name);
    }
    throw Error(ExitCode::internal, str("no target '", name, "'; there are", known));
}

void run(const Target& target, std::string_view bytes) {
    static const std::string base = [] {
        spdlog::set_level(spdlog::level::off);
        const fs::path memory = "/dev/shm";
        const fs::path root = fs::is_directory(memory) ? memory : fs::temp_directory_path();
        return (root / str("tvsgs_fuzz_", getpid())).string();
    }();
    static const struct Cleaner {
        ~Cleaner() {
            std::error_code no_matter;
            fs::remove_all(base, no_matter);
        }
    } cleaner;
    const std::string folder = str(base, "/", target.name), file = str(folder, "/", target.file);
    fs::create_directories(fs::path(file).parent_path());
    for (const bool mended : {false, true}) {
        if (mended && target.mend == nullptr) break;
        write(file, mended ? target.mend(std::string(bytes)) : std::string(bytes));
        try {
            target.read(folder, file);
        } catch (const Error& error) {
            const std::string what = error.what();
            if (error.code() != ExitCode::input && error.code() != ExitCode::usage)
                complain(str("exit code ", static_cast<int>(error.code()), ": ", what));
            const auto control = [](char c) {
                return (static_cast<unsigned char>(c) < 32 && c != '\n') || c == 127;
            };
            if (what.size() < 10 || std::any_of(what.begin(), what.end(), control))
                complain("a message that nobody can read: " + what);
        }
    }
}

}  // namespace tvsgs::fuzz
