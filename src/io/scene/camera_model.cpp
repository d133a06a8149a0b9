#include "io/scene/camera_model.h"

#include <algorithm>
#include <cmath>

#include "core/device/parallel.h"
#include "core/log.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

using enum Distortion::Kind;
constexpr CameraModel kModels[] = {
    {0, "SIMPLE_PINHOLE", 3, 1, none},
    {1, "PINHOLE", 4, 2, none},
    {2, "SIMPLE_RADIAL", 4, 1, radial},
    {3, "RADIAL", 5, 1, radial},
    {4, "OPENCV", 8, 2, radial, true},
    {5, "OPENCV_FISHEYE", 8, 2, fisheye},
    {6, "FULL_OPENCV", 12, 2, radial, true},
    {7, "FOV", 5, 2, fov},
    {8, "SIMPLE_RADIAL_FISHEYE", 4, 1, fisheye},
    {9, "RADIAL_FISHEYE", 5, 1, fisheye},
    {10, "THIN_PRISM_FISHEYE", 12, 2, fisheye, true},
    {11, "RAD_TAN_THIN_PRISM_FISHEYE", 16},
    {12, "SIMPLE_DIVISION", 4},
    {13, "DIVISION", 5},
    {14, "SIMPLE_FISHEYE", 3, 1, fisheye},
    {15, "FISHEYE", 4, 2, fisheye},
    {16, "EUCM", 6},
    {17, "EQUIRECTANGULAR", 2},
};

// Largest half field of view of a useful pinhole image: 60 degrees.
const double kMaxFisheyeRadius = std::tan(1.0471975511965976);

/// Size of a pinhole's pixel in pixels of the photograph; 0 if the pixel shows nothing.
double area_in_photo(const Intrinsics& in, double x, double y, Vec2<double>& place) {
    const Vec2<double> uv{(x - in.cx_px) / in.fx_px, (y - in.cy_px) / in.fy_px};
    const Vec2<double> from = distort(in.distortion, uv);
    place = {from.x * in.fx_px + in.cx_px, from.y * in.fy_px + in.cy_px};
    const Distortion::Kind kind = in.distortion.kind;
    if ((kind == fisheye || kind == fov) && dot(uv, uv) > kMaxFisheyeRadius * kMaxFisheyeRadius)
        return 0;
    if (!(place.x >= 0 && place.x <= in.width_px && place.y >= 0 && place.y <= in.height_px))
        return 0;                     // NaN too
    if (dot(from, uv) < 0) return 0;  // through the centre to the opposite side
    const double step = 1e-5 * (1 + std::sqrt(dot(uv, uv)));
    const Vec2<double> u = distort(in.distortion, {uv.x + step, uv.y}),
                       v = distort(in.distortion, {uv.x, uv.y + step});
    const double area = (u.x - from.x) * (v.y - from.y) - (u.y - from.y) * (v.x - from.x);
    return area > 0 ? area / (step * step) : 0;
}

}  // namespace

const CameraModel* find_camera_model(int id) {
    const auto* const found = std::ranges::find(kModels, id, &CameraModel::id);
    return found == std::end(kModels) ? nullptr : found;
}

const CameraModel* find_camera_model(std::string_view name) {
    const auto* const found = std::ranges::find(kModels, name, &CameraModel::name);
    return found == std::end(kModels) ? nullptr : found;
}

void throw_camera_model(const std::string& path,
                        std::uint32_t camera_id,
                        const std::string& model) {
    throw input_error(
        "E_CAMERA_MODEL: ", path, ": camera ", camera_id, " uses ", model,
        "; expected PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, FOV, "
        "OPENCV_FISHEYE, SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, THIN_PRISM_FISHEYE, SIMPLE_FISHEYE "
        "or FISHEYE. Run \"colmap image_undistorter\" and give its output folder, or calibrate "
        "with one of these models.");
}

bool find_in_photo(const Intrinsics& in, double x, double y, Vec2<double>& place) {
    return area_in_photo(in, x, y, place) > 0;
}

UndistortionLoss undistortion_loss(const Intrinsics& in, int steps) {
    if (in.distortion.kind == none) return {};
    const double share = 1.0 / (steps * steps);
    UndistortionLoss loss{1, 1};
    Vec2<double> place;
    for (int y = 0; y < steps; ++y)
        for (int x = 0; x < steps; ++x)
            if (const double area = area_in_photo(in, (x + 0.5) / steps * in.width_px,
                                                  (y + 0.5) / steps * in.height_px, place);
                area > 0)
                loss.cropped -= area * share, loss.empty -= share;
    return {std::max(loss.cropped, 0.0), std::max(loss.empty, 0.0)};
}

Intrinsics make_intrinsics(const std::string& path,
                           std::uint32_t camera_id,
                           const CameraModel& model,
                           std::uint64_t width,
                           std::uint64_t height,
                           const std::vector<double>& params) {
    if (!model.usable()) throw_camera_model(path, camera_id, model.name);
    const std::string where = str(path, ": camera ", camera_id);
    if (width < 1 || height < 1 || width > 65535 || height > 65535 || width * height > (1u << 30))
        throw input_error("E_CAMERA_SIZE: ", where, ": ", width, "x", height,
                          " pixels; expected 1 to 65535 a side and at most 2^30 in all");
    const auto first = static_cast<std::size_t>(model.focals + 2);  // coefficient

    Intrinsics in;
    in.model = model.name;
    Distortion& d = in.distortion;
    in.width_px = static_cast<int>(width), in.height_px = static_cast<int>(height);
    in.fx_px = params[0], in.fy_px = params[first - 3];
    in.cx_px = params[first - 2], in.cy_px = params[first - 1];
    d.kind = model.kind;
    std::vector<double> k(params.begin() + static_cast<std::ptrdiff_t>(first), params.end());
    if (model.tangential) {  // k1, k2, p1, p2, k3, ...
        d.p1 = k[2], d.p2 = k[3];
        k.erase(k.begin() + 2, k.begin() + 4);
    }
    if (d.kind == fisheye && k.size() > 4) d.s1 = k[4], d.s2 = k[5], k.resize(4);
    std::copy(k.begin(), k.end(), d.k);

    constexpr double kLargest = 1e9;  // px; beyond, float cannot distinguish neighbours
    if (!(in.fx_px > 0 && in.fy_px > 0 && in.fx_px <= kLargest && in.fy_px <= kLargest))
        throw input_error("E_CAMERA_FOCAL: ", where, ": focal lengths ", in.fx_px, ", ", in.fy_px,
                          "; expected positive numbers of pixels");
    if (std::abs(in.cx_px) > kLargest || std::abs(in.cy_px) > kLargest)
        throw input_error("E_CAMERA_PARAMS: ", where, ": principal point (", in.cx_px, ", ",
                          in.cy_px, "); expected pixels, near the middle of the image");
    if (!std::ranges::all_of(params, [](double p) { return std::isfinite(p); }))
        throw input_error("E_CAMERA_PARAMS: ", where, ": a parameter is not a finite number");
    const double size = static_cast<double>(std::max(width, height));
    if (std::min(in.fx_px, in.fy_px) < 0.01 * size)
        throw input_error("E_CAMERA_FOCAL: ", where, ": focal lengths ", in.fx_px, ", ", in.fy_px,
                          " for ", width, "x", height, " pixels see 179 degrees or more; expected ",
                          "pixels, about ", size, ": calibrate again");
    const auto outside = [](double c, int side) { return std::max({0.0, -c, c - side}); };
    if (outside(in.cx_px, in.width_px) > 10 * in.fx_px ||
        outside(in.cy_px, in.height_px) > 10 * in.fy_px)
        throw input_error("E_CAMERA_PARAMS: ", where, ": principal point (", in.cx_px, ", ",
                          in.cy_px, ") turns the whole picture by more than 84 degrees; expected ",
                          "about (", in.width_px / 2, ", ", in.height_px / 2, "): calibrate again");
    for (const double f : {in.fx_px, in.fy_px})
        if (f < 0.05 * size || f > 100 * size) {
            spdlog::warn(
                "{}: focal length {} px is unusual for {}x{} pixels; is the calibration right?",
                where, f, width, height);
            break;
        }
    if (in.cx_px < 0 || in.cx_px > in.width_px || in.cy_px < 0 || in.cy_px > in.height_px)
        spdlog::warn("{}: principal point ({}, {}) is outside the image; is the calibration right?",
                     where, in.cx_px, in.cy_px);

    const bool zero =
        d.p1 == 0 && d.p2 == 0 && std::ranges::all_of(d.k, [](double c) { return c == 0; });
    if (d.kind != fisheye && zero) d.kind = none;
    constexpr double kLeastShare = 0.2;
    if (d.kind != none)
        if (const double share = 1 - undistortion_loss(in, 64).empty; share < kLeastShare)
            throw input_error("E_CAMERA_PARAMS: ", where, ": undistortion keeps ",
                              std::round(1000 * share) / 10, " % of the picture, expected ",
                              100 * kLeastShare,
                              " % or more; are the coefficients in the order of the model?");
    return in;
}

Intrinsics scaled(Intrinsics in, int width_px, int height_px) {
    const double sx = static_cast<double>(width_px) / in.width_px;
    const double sy = static_cast<double>(height_px) / in.height_px;
    in.fx_px *= sx, in.cx_px *= sx, in.fy_px *= sy, in.cy_px *= sy;
    in.width_px = width_px, in.height_px = height_px;
    return in;
}

Vec2<double> distort(const Distortion& d, Vec2<double> uv) {
    if (d.kind == none) return uv;
    if (d.kind == fov) {
        const double r = std::sqrt(dot(uv, uv)), omega = d.k[0];
        if (r < 1e-12) return 2 * std::tan(omega / 2) / omega * uv;
        return std::atan(2 * r * std::tan(omega / 2)) / (r * omega) * uv;
    }
    const bool is_fisheye = d.kind == fisheye;
    if (is_fisheye)  // replaces the tangent by the angle
        if (const double r = std::sqrt(dot(uv, uv)); r > 1e-12) uv = std::atan(r) / r * uv;
    const double u = uv.x, v = uv.y, r2 = dot(uv, uv);
    const double factor = is_fisheye
                              ? 1 + r2 * (d.k[0] + r2 * (d.k[1] + r2 * (d.k[2] + r2 * d.k[3])))
                              : (1 + r2 * (d.k[0] + r2 * (d.k[1] + r2 * d.k[2]))) /
                                    (1 + r2 * (d.k[3] + r2 * (d.k[4] + r2 * d.k[5])));
    return {u * factor + 2 * d.p1 * u * v + d.p2 * (r2 + 2 * u * u) + d.s1 * r2,
            v * factor + 2 * d.p2 * u * v + d.p1 * (r2 + 2 * v * v) + d.s2 * r2};
}

Vec2<double> undistort(const Distortion& d, Vec2<double> place) {
    Vec2<double> uv = place;
    constexpr double h = 1e-6;
    const auto slope = [&](Vec2<double> step) {
        return 1 / (2 * h) * (distort(d, uv + step) - distort(d, uv - step));
    };
    for (int i = 0; i < 20; ++i) {
        const Vec2<double> miss = distort(d, uv) - place, du = slope({h, 0}), dv = slope({0, h});
        const double det = du.x * dv.y - du.y * dv.x;
        uv = uv - Vec2<double>{(miss.x * dv.y - miss.y * dv.x) / det,
                               (miss.y * du.x - miss.x * du.y) / det};
        if (dot(miss, miss) < 1e-28) break;
    }
    return uv;
}

ImageU8 undistorted(const Intrinsics& in, const ImageU8& image, ImageU8& valid) {
    const int width = image.width, height = image.height;
    ImageU8 out(width, height, image.channels);
    valid = ImageU8(width, height, 1);
    parallel_for_heavy(Cpu{}, height, [&](int y) {
        for (int x = 0; x < width; ++x) {
            Vec2<double> place;
            if (!find_in_photo(in, x + 0.5, y + 0.5, place)) continue;
            const double px = place.x, py = place.y;
            valid.at(x, y) = 255;
            // The four neighbouring pixel centres; pixels count from the corner. Repeats the
            // border.
            const double qx = std::clamp(px - 0.5, 0.0, width - 1.0),
                         qy = std::clamp(py - 0.5, 0.0, height - 1.0);
            const int x0 = static_cast<int>(qx), y0 = static_cast<int>(qy);
            const int x1 = std::min(x0 + 1, width - 1), y1 = std::min(y0 + 1, height - 1);
            const double a = qx - x0, b = qy - y0;
            for (int c = 0; c < image.channels; ++c)
                out.at(x, y, c) = static_cast<std::uint8_t>(
                    (1 - b) * ((1 - a) * image.at(x0, y0, c) + a * image.at(x1, y0, c)) +
                    b * ((1 - a) * image.at(x0, y1, c) + a * image.at(x1, y1, c)) + 0.5);
        }
    });
    return out;
}

}  // namespace tvsgs
