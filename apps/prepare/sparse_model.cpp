#include "apps/prepare/sparse_model.h"

#include <algorithm>
#include <cstring>
#include <filesystem>

#include "io/files/atomic_file.h"
#include "io/files/read_file.h"

namespace tvsgs::prepare {
namespace {

/// Reads a file; Writer has the same functions.
class Reader {
public:
    explicit Reader(const std::string& path) : path_(path), bytes_(read_bytes(path)) {}
    template <class... Numbers>
    void numbers(Numbers&... numbers) {
        (read(&numbers, sizeof(Numbers)), ...);
    }
    void text(std::string& text) {
        const std::size_t end = bytes_.find('\0', at_);
        if (end == std::string::npos) cut_off();
        text = bytes_.substr(at_, end - at_);
        at_ = end + 1;
    }
    /// The number of records, of at least `smallest` bytes each.
    template <class Record>
    void count(std::vector<Record>& records, std::size_t smallest) {
        std::uint64_t count = 0;
        numbers(count);
        if (count > (bytes_.size() - at_) / smallest) cut_off();
        records.resize(static_cast<std::size_t>(count));
    }

private:
    void read(void* to, std::size_t count) {
        if (count > bytes_.size() - at_) cut_off();
        std::memcpy(to, bytes_.data() + at_, count);
        at_ += count;
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
    template <class... Numbers>
    void numbers(const Numbers&... numbers) {
        (bytes_.append(reinterpret_cast<const char*>(&numbers), sizeof numbers), ...);
    }
    void text(const std::string& text) { bytes_.append(text.c_str(), text.size() + 1); }
    template <class Record>
    void count(const std::vector<Record>& records, std::size_t) {
        numbers(std::uint64_t{records.size()});
    }
    void write(const std::string& path) const { write_text_file(path, bytes_); }

private:
    std::string bytes_;
};

// The contents of the files, for Reader and Writer.

template <class File, class Image>
void image_of(File& file, Image& image) {
    auto& q = image.quat;
    auto& t = image.translation;
    file.numbers(image.id, q.w, q.x, q.y, q.z, t.x, t.y, t.z, image.camera_id);
    file.text(image.name);
    file.count(image.observations, 24);
    for (auto& seen : image.observations) file.numbers(seen.place.x, seen.place.y, seen.point);
}

template <class File, class Points>
void points_of(File& file, Points& points) {
    file.count(points, 43);
    for (auto& point : points) {
        auto& p = point.position;
        file.numbers(point.id, p.x, p.y, p.z, point.color, point.error);
        file.count(point.track, 8);
        for (auto& [image, observation] : point.track) file.numbers(image, observation);
    }
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
    cameras.count(model.cameras, 24);
    for (SparseCamera& camera : model.cameras) {
        cameras.numbers(camera.id, camera.model, camera.width, camera.height);
        const CameraModel* const known = find_camera_model(camera.model);
        if (!known) throw_camera_model(folder, camera.id, str("the unknown model ", camera.model));
        camera.params.resize(static_cast<std::size_t>(known->params));
        for (double& param : camera.params) cameras.numbers(param);
    }
    Reader images(folder + "/images.bin");
    images.count(model.images, 64);
    for (SparseImage& image : model.images) image_of(images, image);
    std::ranges::sort(model.images, {}, &SparseImage::name);
    Reader points(folder + "/points3D.bin");
    points_of(points, model.points);
    return model;
}

std::uint64_t count_images(const std::string& folder) {
    if (!std::filesystem::exists(folder + "/images.bin")) return 0;
    std::uint64_t count = 0;
    Reader(folder + "/images.bin").numbers(count);
    return count;
}

void write_sparse_model(const std::string& folder, const SparseModel& model) {
    Writer cameras, images, points;
    cameras.count(model.cameras, 0);
    for (const SparseCamera& camera : model.cameras) {
        cameras.numbers(camera.id, camera.model, camera.width, camera.height);
        for (const double param : camera.params) cameras.numbers(param);
    }
    images.count(model.images, 0);
    for (const SparseImage& image : model.images) image_of(images, image);
    points_of(points, model.points);
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

Ray ray_of(const Intrinsics& in, const Rigid3d& camera_from_world, Vec2<double> pixel) {
    const Vec2<double> uv = undistort(
        in.distortion, {(pixel.x - in.cx_px) / in.fx_px, (pixel.y - in.cy_px) / in.fy_px});
    const Rigid3d world_from_camera = inverse(camera_from_world);
    return {world_from_camera.t, normalize(world_from_camera.R * Vec3d{uv.x, uv.y, 1})};
}

std::optional<Vec2<double>> pixel_of(const Intrinsics& in,
                                     const Rigid3d& camera_from_world,
                                     Vec3d point) {
    const Vec3d p = camera_from_world * point;
    if (!(p.z > 0)) return std::nullopt;
    const Vec2<double> uv = distort(in.distortion, {p.x / p.z, p.y / p.z});
    return Vec2<double>{uv.x * in.fx_px + in.cx_px, uv.y * in.fy_px + in.cy_px};
}

std::optional<Vec3d> meeting_point(const std::vector<Ray>& rays) {
    constexpr double kLeastSine = 0.0349;  // 2 degrees
    double widest = 0;
    for (const Ray& a : rays)
        for (const Ray& b : rays) widest = std::max(widest, norm(cross(a.direction, b.direction)));
    if (!(widest >= kLeastSine)) return std::nullopt;
    Vec3d columns[3]{}, wanted{};  // sum of I - d d^T, and of the same times the origins
    for (const Ray& ray : rays) {
        const Vec3d d = ray.direction;
        for (int c = 0; c < 3; ++c) columns[c] += -d[c] * d, columns[c][c] += 1;
        wanted += ray.origin - dot(d, ray.origin) * d;
    }
    const double det = dot(columns[0], cross(columns[1], columns[2]));
    return Vec3d{dot(wanted, cross(columns[1], columns[2])) / det,
                 dot(columns[0], cross(wanted, columns[2])) / det,
                 dot(columns[0], cross(columns[1], wanted)) / det};
}

}  // namespace tvsgs::prepare
