// Reads transforms.json of Blender scenes, nerfstudio and instant-ngp.
// [docs/method/input.md#transformsjson]
#include <cmath>
#include <filesystem>
#include <optional>
#include <set>

#include "core/log.h"
#include "io/files/json_value.h"
#include "io/files/read_file.h"
#include "io/images/image_file.h"
#include "io/scene/scene_layout.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

/// One file. Each error names it.
struct TransformsReader {
    std::string path;
    JsonValue file;

    explicit TransformsReader(const std::string& p)
        : path(p), file(parse_json_value(read_bytes(p), "E_TRANSFORMS: " + p)) {
        if (!file.is(JsonValue::Kind::object)) throw wrong("not a JSON object");
        if (file["frames"].items.empty()) throw wrong("no frames; expected a list \"frames\"");
    }
    template <class... Parts>
    Error wrong(const Parts&... what) const {
        return input_error("E_TRANSFORMS: ", path, ": ", what...);
    }
    /// A number of the frame; else of the file.
    std::optional<double> number(const JsonValue& frame, const char* key) const {
        const JsonValue& found = frame[key] ? frame[key] : file[key];
        if (!found) return std::nullopt;
        if (!found.is(JsonValue::Kind::number)) throw wrong("'", key, "' is not a number");
        return found.number;
    }
    std::string text(const JsonValue& object, const char* key) const {
        const JsonValue& found = object[key];
        if (found && !found.is(JsonValue::Kind::text)) throw wrong("'", key, "' is not text");
        return found.text;
    }
    /// The file's name relative to the scene.
    std::string name(const JsonValue& frame, const char* key) const {
        const fs::path clean = fs::path(text(frame, key)).lexically_normal();
        const std::string found = clean.generic_string();
        if (found.empty() || clean.is_absolute() || found.starts_with("..") || found.size() > 4096)
            throw input_error("E_BAD_NAME: ", path, ": ", key, " '", shown(text(frame, key)),
                              "'; expected a relative path without '..'");
        return found;
    }
    /// Converts camera-to-world with x right, y up, z backwards to world-to-camera with y down, z
    /// forward.
    Rigid3d pose(const JsonValue& frame, const std::string& image) const {
        const std::string where = str(path, ": frame '", image, "'");
        if (!frame["transform_matrix"]) throw wrong("a frame has no transform_matrix");
        const std::vector<JsonValue>& rows = frame["transform_matrix"].items;
        bool fits = rows.size() == 3 || rows.size() == 4;
        Mat3<double> R;
        Vec3d t;
        for (int r = 0; r < 3 && fits; ++r) {
            const std::vector<JsonValue>& row = rows[static_cast<std::size_t>(r)].items;
            fits = row.size() == 4;
            for (int c = 0; c < 4 && fits; ++c) {
                // JSON has no NaN and writes null instead.
                const double v = row[static_cast<std::size_t>(c)].number_or(std::nan(""));
                if (c == 3)
                    t[r] = v;
                else
                    R[r][c] = c == 0 ? v : -v;
            }
        }
        if (!fits) throw wrong("transform_matrix: expected 4x4 or 3x4 numbers");
        return inverse(checked_pose(R, t, where));
    }
    Intrinsics camera(const JsonValue& frame, const std::string& image) const {
        std::optional<double> w = number(frame, "w"), h = number(frame, "h");
        if (!w || !h) {
            const ImageSize size = read_image_size(image);
            w = size.width, h = size.height;
        }
        if (!(*w >= 1 && *h >= 1 && *w <= 65535 && *h <= 65535))
            throw input_error("E_CAMERA_SIZE: ", path, ": ", *w, "x", *h, " pixels");
        std::optional<double> fx = number(frame, "fl_x");
        std::optional<double> fy = number(frame, "fl_y");
        if (!fx)
            if (const auto angle = number(frame, "camera_angle_x"))
                fx = 0.5 * *w / std::tan(0.5 * *angle);
        if (!fx) throw wrong("no focal length; expected fl_x or camera_angle_x");
        const auto value = [&](const char* key, double fallback) {
            return number(frame, key).value_or(fallback);
        };
        const std::string model_name =
            frame["camera_model"] ? text(frame, "camera_model") : text(file, "camera_model");
        std::vector<double> params = {*fx, fy.value_or(*fx), value("cx", 0.5 * *w),
                                      value("cy", 0.5 * *h)};
        const char* model = "OPENCV";
        if (model_name == "OPENCV_FISHEYE") {
            model = "OPENCV_FISHEYE";
            for (const char* key : {"k1", "k2", "k3", "k4"}) params.push_back(value(key, 0));
        } else if (model_name.empty() || model_name == "PINHOLE" || model_name == "OPENCV" ||
                   model_name == "SIMPLE_PINHOLE" || model_name == "SIMPLE_RADIAL" ||
                   model_name == "RADIAL") {
            for (const char* key : {"k1", "k2", "p1", "p2"}) params.push_back(value(key, 0));
            if (value("k3", 0) != 0 || value("k4", 0) != 0) {
                model = "FULL_OPENCV";
                params.insert(params.end(), {value("k3", 0), value("k4", 0), 0, 0});
            }
        } else {
            throw_camera_model(path, 0, model_name);
        }
        return make_intrinsics(path, 0, *find_camera_model(model), static_cast<std::uint64_t>(*w),
                               static_cast<std::uint64_t>(*h), params);
    }
};

/// Adds the extension found on the disk to a name without one.
std::string with_extension(const fs::path& folder, const std::string& name) {
    if (fs::is_regular_file(folder / name)) return name;
    for (const char* extension : {".png", ".jpg", ".jpeg", ".JPG"})
        if (fs::is_regular_file(folder / (name + extension))) return name + extension;
    return name;
}

}  // namespace

SceneLayout read_blender_layout(const SceneOptions& options) {
    const fs::path scene(options.path);
    SceneLayout layout{"blender", (scene / "transforms_train.json").string(), options.path};
    layout.alpha_on_black = true;
    for (const bool test : {false, true}) {
        const std::string path =
            (scene / (test ? "transforms_test.json" : "transforms_train.json")).string();
        if (test && !fs::exists(path)) break;
        const TransformsReader in(path);
        std::optional<ImageSize> size;  // read once for all frames: some files may be missing
        for (const JsonValue& frame : in.file["frames"].items) {
            const std::string name = with_extension(scene, in.name(frame, "file_path"));
            if (!size && fs::exists(scene / name)) size = read_image_size((scene / name).string());
        }
        if (!size)
            throw input_error("E_NO_IMAGES: ", path, ": none of its ",
                              in.file["frames"].items.size(), " images is in ", options.path);
        for (const JsonValue& frame : in.file["frames"].items) {
            const std::string name = with_extension(scene, in.name(frame, "file_path"));
            JsonValue sized = frame;
            if (!in.number(frame, "w") || !in.number(frame, "h"))
                sized.set("w", size->width), sized.set("h", size->height);
            add_view(layout, name, in.camera(sized, name), in.pose(frame, name));
            (test ? layout.test : layout.train).push_back(name);
        }
    }
    if (fs::exists(scene / "points3d.ply")) layout.points = (scene / "points3d.ply").string();
    return finished(std::move(layout));
}

SceneLayout read_nerfstudio_layout(const SceneOptions& options) {
    const fs::path scene(options.path);
    SceneLayout layout{"nerfstudio", (scene / "transforms.json").string(), options.path};
    const TransformsReader in(layout.source);
    const auto listed = [&](const JsonValue& frame, const char* key) {
        std::string name = in.name(frame, key);
        // --images names another folder of the same photographs, such as images_2.
        if (options.images != "images" && name.starts_with("images/"))
            name = options.images + name.substr(6);
        return with_extension(scene, name);
    };
    std::set<std::string> unknown;
    for (const JsonValue& frame : in.file["frames"].items) {
        const std::string name = listed(frame, "file_path");
        // Lengths in pixels are of the listed file, angles of any size.
        fs::path file = scene / with_extension(scene, in.name(frame, "file_path"));
        if (!in.number(frame, "fl_x") && !fs::exists(file)) file = scene / name;
        const bool sized = in.number(frame, "w") && in.number(frame, "h");
        if (!sized && !fs::exists(file)) {
            unknown.insert(name);
            continue;
        }
        add_view(layout, name, in.camera(frame, file.string()), in.pose(frame, name));
        if (frame["mask_path"])
            layout.masks.emplace(name, (scene / in.name(frame, "mask_path")).string());
    }
    if (!unknown.empty())
        spdlog::warn("{}: {} photographs without size (w, h) not found, skipped, such as {}",
                     layout.source, unknown.size(), *unknown.begin());
    for (const auto& [key, list] :
         {std::pair{"train_filenames", &layout.train}, {"test_filenames", &layout.test}}) {
        for (const JsonValue& entry : in.file[key].items)
            if (entry.is(JsonValue::Kind::text))
                if (const std::string name = listed(JsonValue().add("name", entry), "name");
                    !unknown.contains(name))
                    list->push_back(name);
    }
    if (in.file["ply_file_path"])
        layout.points = (scene / in.name(in.file, "ply_file_path")).string();
    return finished(std::move(layout));
}

}  // namespace tvsgs
