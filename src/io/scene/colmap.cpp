#include "io/scene/colmap.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>
#include <set>

#include "core/grouped.h"
#include "core/log.h"
#include "io/files/number_types.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

/// Parser of a binary file. Checks every read against the remaining bytes.
class BinaryReader {
public:
    explicit BinaryReader(const std::string& path) : path_(path), bytes_(read_bytes(path)) {}

    template <class T>
    T get(const char* /*what*/ = "") {
        need(sizeof(T));
        offset_ += sizeof(T);
        return load<T>(&bytes_[offset_ - sizeof(T)]);
    }
    std::string get_name() {
        const std::size_t end = bytes_.find('\0', offset_);
        if (end == std::string::npos) corrupt("a name has no end");
        std::string name = bytes_.substr(offset_, end - offset_);
        offset_ = end + 1;
        return name;
    }
    /// Reads a number of records that each take at least `smallest` bytes.
    std::size_t get_count(std::size_t smallest) {
        const auto count = get<std::uint64_t>();
        if (count > left() / smallest) {
            offset_ -= sizeof count;
            corrupt("a count of ", count, ", but only ", left() - sizeof count, " bytes follow");
        }
        return static_cast<std::size_t>(count);
    }
    void start_record(std::size_t number) { record_ = number; }
    void finish() const {
        if (left() > 0) spdlog::warn("{}: ignored {} bytes after the last record", path_, left());
    }
    std::string where() const { return str(path_, ": record ", record_); }
    const std::string& path() const { return path_; }

private:
    std::size_t left() const { return bytes_.size() - offset_; }
    void need(std::size_t bytes) const {
        if (bytes > left()) corrupt("expected ", bytes, " more bytes, found ", left());
    }
    template <class... Parts>
    [[noreturn]] void corrupt(const Parts&... what) const {
        throw input_error("E_COLMAP_CORRUPT: ", path_, ": byte ", offset_, ", record ", record_,
                          ": ", what...,
                          "; the file is cut off or damaged: copy or export it again");
    }
    std::string path_, bytes_;
    std::size_t offset_ = 0, record_ = 0;
};

/// Parser of a text file by lines and words.
class TextReader {
public:
    explicit TextReader(const std::string& path)
        : path_(path), bytes_(read_text(path)), rest_(bytes_) {}

    /// Goes to the next line; false at the end.
    bool next_line() {
        if (rest_.empty()) return false;
        line_ = trimmed(tvsgs::next_line(rest_));
        ++number_;
        return true;
    }
    /// Goes to the next line that is neither empty nor a comment.
    bool next_record() {
        while (next_line())
            if (!line_.empty() && line_[0] != '#') return true;
        return false;
    }
    template <class T>
    T get(const char* what) {
        const std::string_view word = next_word(line_);
        T value{};
        if (word.empty()) corrupt("no ", what);
        if (!parse_number(word, value)) corrupt("'", shown(word), "' is not a valid ", what);
        return value;
    }
    std::string_view get_word() { return next_word(line_); }
    std::string_view rest_of_line() { return std::exchange(line_, {}); }
    bool line_is_empty() const { return trimmed(line_).empty(); }
    template <class... Parts>
    [[noreturn]] void corrupt(const Parts&... what) const {
        throw input_error("E_COLMAP_CORRUPT: ", where(), ": ", what...,
                          "; the file is cut off or damaged: copy or export it again");
    }
    std::string where() const { return str(path_, ": line ", number_); }
    const std::string& path() const { return path_; }

private:
    std::string path_, bytes_;
    std::string_view rest_, line_;
    std::size_t number_ = 0;
};

void add_camera(ColmapModel& model,
                const std::string& where,
                std::uint32_t id,
                const Intrinsics& camera) {
    if (!model.cameras.emplace(id, camera).second)
        throw input_error("E_DUPLICATE_ID: ", where, ": camera ", id, " is defined twice");
}

void read_cameras(BinaryReader&& in, ColmapModel& model) {
    const std::size_t count = in.get_count(24 + 2 * sizeof(double));
    for (std::size_t i = 1; i <= count; ++i) {
        in.start_record(i);
        const auto id = in.get<std::uint32_t>();
        const auto model_id = in.get<std::int32_t>();
        const auto width = in.get<std::uint64_t>(), height = in.get<std::uint64_t>();
        const CameraModel* camera_model = find_camera_model(model_id);
        if (!camera_model) throw_camera_model(in.path(), id, str("the unknown model ", model_id));
        std::vector<double> params(static_cast<std::size_t>(camera_model->params));
        for (double& param : params) param = in.get<double>();
        add_camera(model, in.where(), id,
                   make_intrinsics(in.path(), id, *camera_model, width, height, params));
    }
    in.finish();
}

void read_cameras(TextReader&& in, ColmapModel& model) {
    while (in.next_record()) {
        const auto id = in.get<std::uint32_t>("camera id");
        const std::string name(in.get_word());
        const auto width = in.get<std::uint64_t>("width"), height = in.get<std::uint64_t>("height");
        const CameraModel* camera_model = find_camera_model(name);
        if (!camera_model)
            throw_camera_model(in.path(), id, str("the unknown model '", shown(name), "'"));
        if (!camera_model->usable()) throw_camera_model(in.path(), id, name);
        std::vector<double> params;
        while (!in.line_is_empty()) params.push_back(in.get<double>("camera parameter"));
        if (static_cast<int>(params.size()) != camera_model->params)
            in.corrupt(params.size(), " parameters; expected the ", camera_model->params, " of ",
                       name);
        add_camera(model, in.where(), id,
                   make_intrinsics(in.path(), id, *camera_model, width, height, params));
    }
}

void check_name(const std::string& where, const std::string& name) {
    const fs::path path(name);
    bool bad = name.empty() || name.size() > 4096 || path.is_absolute() ||
               name.find('\0') != std::string::npos;
    for (const auto& part : path) bad |= part == "..";
    if (bad)
        throw input_error("E_BAD_NAME: ", where, ": image name '", shown(name),
                          "'; expected a relative path of 1 to 4096 characters without '..'");
}

void add_image(ColmapModel& model, const std::string& where, ColmapImage image, Quat<double> q) {
    check_name(where, image.name);
    const std::string who = str(where, ": image '", image.name, "'");
    const Vec3d t = image.camera_from_world.t;
    if (!std::isfinite(q.w + q.x + q.y + q.z) || !is_finite(t))
        throw input_error("E_POSE_NAN: ", who, ": the pose is not finite; remove the image");
    constexpr double kFarthest = 1e9;  // world units, as for points: float has no precision beyond
    if (!(std::abs(t.x) <= kFarthest && std::abs(t.y) <= kFarthest && std::abs(t.z) <= kFarthest))
        throw input_error("E_POSE_RANGE: ", who, ": translation (", t.x, ", ", t.y, ", ", t.z,
                          "); expected at most 1e9 each: rescale the model or remove the image");
    const double length = std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
    if (!(length >= 1e-8 && std::isfinite(length)))
        throw input_error("E_POSE_QUAT: ", who, ": quaternion of length ", length, "; expected 1");
    if (std::abs(length - 1) > 1e-3)
        spdlog::warn("{}: normalised a quaternion of length {}", who, length);
    image.camera_from_world.R = rotation(normalize(q));
    model.images.push_back(std::move(image));
}

template <class T, class Reader>
Vec3<T> get_vec3(Reader& in, const char* what) {
    const T x = in.template get<T>(what), y = in.template get<T>(what),
            z = in.template get<T>(what);
    return {x, y, z};
}

/// Reads an image up to its name, except for its rotation `q`.
template <class Reader>
ColmapImage read_pose(Reader& in, Quat<double>& q) {
    ColmapImage image;
    image.id = in.template get<std::uint32_t>("image id");
    for (double* const to : {&q.w, &q.x, &q.y, &q.z}) *to = in.template get<double>("quaternion");
    image.camera_from_world.t = get_vec3<double>(in, "translation");
    image.camera_id = in.template get<std::uint32_t>("camera id");
    return image;
}

void read_images(BinaryReader&& in, ColmapModel& model) {
    const std::size_t count = in.get_count(74);
    for (std::size_t i = 1; i <= count; ++i) {
        in.start_record(i);
        Quat<double> q;
        ColmapImage image = read_pose(in, q);
        image.name = in.get_name();
        for (std::size_t left = in.get_count(24); left > 0; --left) {
            const auto x = in.get<double>(), y = in.get<double>();
            in.get<std::uint64_t>();  // id of the point: its track has the same information
            image.observations.push_back({static_cast<float>(x), static_cast<float>(y)});
        }
        add_image(model, in.where(), std::move(image), q);
    }
    in.finish();
}

void read_images(TextReader&& in, ColmapModel& model) {
    while (in.next_record()) {
        Quat<double> q;
        ColmapImage image = read_pose(in, q);
        image.name = trimmed(in.rest_of_line());
        add_image(model, in.where(), std::move(image), q);
        // The next line holds the observations, three words each. It may be empty, but always
        // exists.
        if (!in.next_line()) break;
        int words = 0;
        Vec2<float> seen;
        for (std::string_view word; !(word = in.get_word()).empty(); ++words) {
            float& value = words % 3 == 0 ? seen.x : seen.y;
            if (words % 3 < 2 && !parse_number(word, value)) value = NAN;
            if (words % 3 == 2) model.images.back().observations.push_back(seen);
        }
        if (words % 3 != 0)
            in.corrupt("expected observations, X Y POINT3D_ID each (or an empty line)");
    }
}

void check_images(const std::string& path, ColmapModel& model) {
    if (model.images.empty())
        throw input_error("E_NO_IMAGES: ", path,
                          ": no images; was the reconstruction empty? Run COLMAP's mapper again");
    std::set<std::uint32_t> ids;
    for (const ColmapImage& image : model.images) {
        if (!ids.insert(image.id).second)
            throw input_error("E_DUPLICATE_ID: ", path, ": image ", image.id, " ('", image.name,
                              "') is defined twice");
        if (!model.cameras.contains(image.camera_id)) {
            std::string known;
            for (const auto& [id, camera] : model.cameras) {
                known += str(known.empty() ? "" : ", ", id);
                if (known.size() > 200) break;
            }
            throw input_error("E_MISSING_CAMERA: ", path, ": image '", image.name,
                              "' refers to camera ", image.camera_id, ", but the model defines ",
                              known.empty() ? "none" : known);
        }
    }
    sort_by_name(model.images, path);
}

/// Collects points. Drops and counts invalid ones.
struct PointCollector {
    ColmapPoints points;
    std::size_t dropped = 0;

    void add(Vec3d position, Vec3f color_255) {
        const bool usable = std::abs(position.x) <= 1e9 && std::abs(position.y) <= 1e9 &&
                            std::abs(position.z) <= 1e9;
        if (!usable) {
            ++dropped;
            points.track.resize(points.track_begin.back());
            points.track_observation.resize(points.track_begin.back());
            return;
        }
        points.positions.push_back(position);
        points.colors.push_back(color_255 / 255);
        points.track_begin.push_back(points.track.size());
    }
    ColmapPoints finish(const std::string& path) {
        if (dropped > 0)
            spdlog::warn("{}: dropped {} points: positions not finite or beyond 1e9", path,
                         grouped(dropped));
        return std::move(points);
    }
};

ColmapPoints read_points(BinaryReader&& in) {
    PointCollector out;
    const std::size_t count = in.get_count(51);
    for (std::size_t i = 1; i <= count; ++i) {
        in.start_record(i);
        in.get<std::uint64_t>();  // id
        const auto position = get_vec3<double>(in, "");
        const auto color = get_vec3<std::uint8_t>(in, "");
        in.get<double>();  // reprojection error
        for (std::size_t left = in.get_count(8); left > 0; --left) {
            out.points.track.push_back(in.get<std::uint32_t>());
            out.points.track_observation.push_back(in.get<std::uint32_t>());
        }
        out.add(position, vec_cast<float>(color));
    }
    in.finish();
    return out.finish(in.path());
}

ColmapPoints read_points(TextReader&& in) {
    PointCollector out;
    while (in.next_record()) {
        in.get<std::uint64_t>("point id");
        const auto position = get_vec3<double>(in, "position");
        const auto color = get_vec3<std::uint8_t>(in, "colour (0-255)");
        in.get<double>("reprojection error");
        while (!in.line_is_empty()) {
            out.points.track.push_back(in.get<std::uint32_t>("image id"));
            out.points.track_observation.push_back(in.get<std::uint32_t>("observation index"));
        }
        out.add(position, vec_cast<float>(color));
    }
    return out.finish(in.path());
}

/// folder/name.bin if it exists, else folder/name.txt, else nothing.
std::optional<std::string> find_file(const std::string& folder, const char* name) {
    for (const char* extension : {".bin", ".txt"}) {
        const fs::path path = fs::path(folder) / (std::string(name) + extension);
        if (is_file(path)) return path.string();
    }
    return std::nullopt;
}

template <class Action>
auto with_reader(const std::string& path, const Action& action) {
    return path.ends_with(".bin") ? action(BinaryReader(path)) : action(TextReader(path));
}

}  // namespace

void sort_by_name(std::vector<ColmapImage>& images, const std::string& source) {
    std::ranges::sort(images, {}, &ColmapImage::name);
    const auto same = std::ranges::adjacent_find(images, {}, &ColmapImage::name);
    if (same != images.end())
        throw input_error("E_DUPLICATE_ID: ", source, ": two images are named '", same->name, "'");
}

std::vector<std::string> missing_colmap_files(const std::string& folder) {
    std::vector<std::string> missing;
    for (const char* name : {"cameras", "images"})
        if (!find_file(folder, name)) missing.push_back(str(name, ".{bin,txt}"));
    return missing;
}

ColmapModel read_colmap_model(const std::string& folder) {
    const auto cameras = find_file(folder, "cameras"), images = find_file(folder, "images");
    if (!cameras || !images)
        throw input_error("E_SCENE_LAYOUT: ", folder,
                          ": expected cameras.{bin,txt} and images.{bin,txt}");
    ColmapModel model;
    with_reader(*cameras, [&](auto&& in) { read_cameras(std::move(in), model); });
    with_reader(*images, [&](auto&& in) { read_images(std::move(in), model); });
    check_images(*images, model);
    return model;
}

ColmapPoints read_colmap_points(const std::string& folder) {
    const auto path = find_file(folder, "points3D");
    if (!path) return {};
    return with_reader(*path, [](auto&& in) { return read_points(std::move(in)); });
}

}  // namespace tvsgs
