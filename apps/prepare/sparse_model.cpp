#include "apps/prepare/sparse_model.h"

#include <algorithm>
#include <cstring>
#include <filesystem>

#include "core/math/rigid.h"
#include "io/files/atomic_file.h"
#include "io/files/read_file.h"

namespace tvsgs::prepare {
namespace {

class Reader {
public:
    explicit Reader(const std::string& path) : path_(path), bytes_(read_bytes(path)) {}
    template <class T>
    T get() {
        need(sizeof(T));
        T value;
        std::memcpy(&value, bytes_.data() + at_, sizeof(T));
        at_ += sizeof(T);
        return value;
    }
    /// Reads a number of records of at least `smallest` bytes each.
    std::size_t get_count(std::size_t smallest) {
        const auto count = get<std::uint64_t>();
        if (count > (bytes_.size() - at_) / smallest) cut_off();
        return static_cast<std::size_t>(count);
    }
    std::string get_name() {
        const std::size_t end = bytes_.find('\0', at_);
        if (end == std::string::npos) cut_off();
        std::string name = bytes_.substr(at_, end - at_);
        at_ = end + 1;
        return name;
    }

private:
    void need(std::size_t count) const {
        if (count > bytes_.size() - at_) cut_off();
    }
    [[noreturn]] void cut_off() const {
        throw input_error("E_COLMAP_CORRUPT: ", path_, ": byte ", at_,
                          ": the file is cut off or damaged");
    }
    std::string path_, bytes_;
    std::size_t at_ = 0;
};

class Writer {
public:
    template <class T>
    Writer& put(T value) {
        bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
        return *this;
    }
    Writer& put_text(const std::string& text) {
        bytes_.append(text.c_str(), text.size() + 1);
        return *this;
    }
    void write(const std::string& path) const { write_text_file(path, bytes_); }

private:
    std::string bytes_;
};

Vec3d get_vec3(Reader& in) {
    const auto x = in.get<double>(), y = in.get<double>(), z = in.get<double>();
    return {x, y, z};
}

SparseImage get_image(Reader& in) {
    SparseImage image;
    image.id = in.get<std::uint32_t>();
    image.quat.w = in.get<double>();
    const Vec3d xyz = get_vec3(in);
    image.quat.x = xyz.x, image.quat.y = xyz.y, image.quat.z = xyz.z;
    image.translation = get_vec3(in);
    image.camera_id = in.get<std::uint32_t>();
    image.name = in.get_name();
    image.observations.resize(in.get_count(24));
    for (SparseObservation& seen : image.observations) {
        seen.place.x = in.get<double>(), seen.place.y = in.get<double>();
        seen.point = in.get<std::uint64_t>();
    }
    return image;
}

}  // namespace

const SparseCamera& SparseModel::camera(std::uint32_t id) const {
    const auto found = std::ranges::find(cameras, id, &SparseCamera::id);
    if (found == cameras.end()) throw input_error("E_MISSING_CAMERA: the model has no camera ", id);
    return *found;
}

SparseModel read_sparse_model(const std::string& folder) {
    SparseModel model;
    Reader cameras(folder + "/cameras.bin");
    model.cameras.resize(cameras.get_count(24));
    for (SparseCamera& camera : model.cameras) {
        camera.id = cameras.get<std::uint32_t>();
        camera.model = cameras.get<std::int32_t>();
        camera.width = cameras.get<std::uint64_t>(), camera.height = cameras.get<std::uint64_t>();
        const CameraModel* const known = find_camera_model(camera.model);
        if (!known) throw_camera_model(folder, camera.id, str("the unknown model ", camera.model));
        camera.params.resize(static_cast<std::size_t>(known->params));
        for (double& param : camera.params) param = cameras.get<double>();
    }
    Reader images(folder + "/images.bin");
    for (std::size_t left = images.get_count(64); left > 0; --left)
        model.images.push_back(get_image(images));
    std::ranges::sort(model.images, {}, &SparseImage::name);
    Reader points(folder + "/points3D.bin");
    model.points.resize(points.get_count(43));
    for (SparsePoint& point : model.points) {
        point.id = points.get<std::uint64_t>();
        point.position = get_vec3(points);
        for (std::uint8_t& c : point.color) c = points.get<std::uint8_t>();
        point.error = points.get<double>();
        point.track.resize(points.get_count(8));
        for (auto& [image, observation] : point.track) {
            image = points.get<std::uint32_t>();
            observation = points.get<std::uint32_t>();
        }
    }
    return model;
}

std::uint64_t count_images(const std::string& folder) {
    if (!std::filesystem::exists(folder + "/images.bin")) return 0;
    return Reader(folder + "/images.bin").get<std::uint64_t>();
}

void write_sparse_model(const std::string& folder, const SparseModel& model) {
    Writer cameras, images, points;
    cameras.put<std::uint64_t>(model.cameras.size());
    for (const SparseCamera& camera : model.cameras) {
        cameras.put(camera.id).put<std::int32_t>(camera.model);
        cameras.put(camera.width).put(camera.height);
        for (const double param : camera.params) cameras.put(param);
    }
    images.put<std::uint64_t>(model.images.size());
    for (const SparseImage& image : model.images) {
        const Quat<double>& q = image.quat;
        const Vec3d t = image.translation;
        images.put(image.id).put(q.w).put(q.x).put(q.y).put(q.z).put(t.x).put(t.y).put(t.z);
        images.put(image.camera_id).put_text(image.name);
        images.put<std::uint64_t>(image.observations.size());
        for (const SparseObservation& seen : image.observations)
            images.put(seen.place.x).put(seen.place.y).put(seen.point);
    }
    points.put<std::uint64_t>(model.points.size());
    for (const SparsePoint& point : model.points) {
        points.put(point.id).put(point.position.x).put(point.position.y).put(point.position.z);
        for (const std::uint8_t c : point.color) points.put(c);
        points.put(point.error).put<std::uint64_t>(point.track.size());
        for (const auto& [image, observation] : point.track) points.put(image).put(observation);
    }
    cameras.write(folder + "/cameras.bin");
    images.write(folder + "/images.bin");
    points.write(folder + "/points3D.bin");
}

void move(SparseModel& model, const Similarity& to_new) {
    for (SparseImage& image : model.images) {
        // x = R_c p + t_c with p = R^T (p_new - t) / scale; the camera's frame is scaled, too.
        const Mat3<double> R = rotation(normalize(image.quat)) * transpose(to_new.R);
        image.translation = to_new.scale * image.translation - R * to_new.t;
        image.quat = quaternion(R);
    }
    for (SparsePoint& point : model.points) point.position = to_new * point.position;
}

bool take_lens(SparseCamera& camera, const std::string& lens) {
    constexpr const char *kPlain[] = {"RADIAL", "OPENCV", "FULL_OPENCV"},
                         *kFisheye[] = {"RADIAL_FISHEYE", "OPENCV_FISHEYE", "THIN_PRISM_FISHEYE"};
    const std::string now = find_camera_model(camera.model)->name;
    const bool plain = now == "SIMPLE_RADIAL" && std::ranges::count(kPlain, lens) > 0,
               fisheye = now == "SIMPLE_RADIAL_FISHEYE" && std::ranges::count(kFisheye, lens) > 0;
    if (!plain && !fisheye) return false;
    const CameraModel& wanted = *find_camera_model(lens);
    // f, cx, cy, k; models with two focal lengths have fx, fy.
    if (!lens.starts_with("RADIAL")) camera.params.insert(camera.params.begin(), camera.params[0]);
    camera.params.resize(static_cast<std::size_t>(wanted.params));
    camera.model = wanted.id;
    return true;
}

Intrinsics intrinsics_of(const SparseCamera& camera) {
    return make_intrinsics("COLMAP's result", camera.id, *find_camera_model(camera.model),
                           camera.width, camera.height, camera.params);
}

}  // namespace tvsgs::prepare
