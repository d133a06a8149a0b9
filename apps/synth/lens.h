// Lens models for the cameras of tvsgs-synth: distort rendered pinhole images.
#pragma once

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/device/parallel.h"
#include "core/error.h"
#include "core/log.h"
#include "core/scene/camera.h"
#include "core/scene/image.h"
#include "io/scene/camera_model.h"

namespace tvsgs::synth {

/// Coefficients for each camera model of COLMAP; they bend straight edges by a few per cent of the
/// image.
inline const std::map<std::string, std::vector<double>> kLenses = {
    {"PINHOLE", {}},
    {"SIMPLE_RADIAL", {-0.25}},
    {"RADIAL", {-0.25, 0.08}},
    {"OPENCV", {-0.2, 0.05, 0.002, -0.003}},
    {"FULL_OPENCV", {-0.2, 0.05, 0.002, -0.003, 0.01, 0.02, -0.01, 0.005}},
    {"FOV", {0.9}},
    {"OPENCV_FISHEYE", {0.03, -0.02, 0.01, -0.005}},
    {"SIMPLE_RADIAL_FISHEYE", {0.05}},
    {"RADIAL_FISHEYE", {0.05, -0.02}},
    {"THIN_PRISM_FISHEYE", {0.03, -0.02, 0.002, -0.003, 0.01, -0.005, 0.004, -0.005}}};

class Lens {
public:
    /// Uses `samples` x `samples` per pixel. `camera` gives focal lengths (models with one use the
    /// first), principal point and size.
    Lens(const std::string& name, const Camera& camera, int samples) : samples_(samples) {
        const CameraModel& model = *find_camera_model(name);
        const std::vector<double>& coefficients = kLenses.at(name);
        std::vector<double> params{double(camera.fx_px), double(camera.fy_px), double(camera.cx_px),
                                   double(camera.cy_px)};
        if (static_cast<std::size_t>(model.params) < params.size() + coefficients.size())
            params.erase(params.begin() + 1);
        params.insert(params.end(), coefficients.begin(), coefficients.end());
        colmap_ = str(name, ' ', camera.width_px, ' ', camera.height_px);
        for (const double p : params) colmap_ += fmt::format(" {:.17g}", p);
        in_ = make_intrinsics("tvsgs-synth", 1, model, static_cast<std::uint64_t>(camera.width_px),
                              static_cast<std::uint64_t>(camera.height_px), params);
        if (in_.distortion.kind == Distortion::Kind::none) return;
        // For each sample of the photograph, its position in the finer pinhole image.
        const int width = camera.width_px * samples, height = camera.height_px * samples;
        places_.resize(static_cast<std::size_t>(width) * height);
        parallel_for(Cpu{}, width * height, [&](int i) {
            places_[i] = double(samples) * undistorted_place({(i % width + 0.5) / samples,
                                                              (i / width + 0.5) / samples});
        });
        low_ = high_ = places_[0];
        for (const Vec2<double>& p : places_) {
            low_ = {std::min(low_.x, p.x), std::min(low_.y, p.y)};
            high_ = {std::max(high_.x, p.x), std::max(high_.y, p.y)};
        }
        low_ = {std::floor(low_.x) - 1, std::floor(low_.y) - 1};
    }

    /// The camera's line of cameras.txt, after its number.
    const std::string& colmap() const { return colmap_; }
    /// Vertical focal length of the pinhole: the lens's, if its model has one focal length.
    float fy_px() const { return static_cast<float>(in_.fy_px); }

    /// The pinhole that covers the field of view of the lens, with `samples` times the resolution.
    Camera pinhole(const Camera& view) const {
        Camera fine = scaled_camera(view, view.width_px * samples_, view.height_px * samples_);
        if (places_.empty()) return fine;
        fine.cx_px -= static_cast<float>(low_.x), fine.cy_px -= static_cast<float>(low_.y);
        fine.width_px = static_cast<int>(high_.x - low_.x) + 2;
        fine.height_px = static_cast<int>(high_.y - low_.y) + 2;
        return fine;
    }

    /// Distorts the pinhole's image; `samples` times the photograph's resolution.
    ImageF bent(const ImageF& picture) const {
        if (places_.empty()) return picture;
        ImageF out(in_.width_px * samples_, in_.height_px * samples_, picture.channels);
        parallel_for(Cpu{}, out.width * out.height, [&](int i) {
            const Vec2<double> p = places_[i] - low_;
            // Bilinear between pixel centres.
            const double qx = std::clamp(p.x - 0.5, 0.0, picture.width - 1.001),
                         qy = std::clamp(p.y - 0.5, 0.0, picture.height - 1.001);
            const int x = static_cast<int>(qx), y = static_cast<int>(qy);
            const auto a = static_cast<float>(qx - x), b = static_cast<float>(qy - y);
            for (int c = 0; c < out.channels; ++c)
                out.at(i % out.width, i / out.width, c) =
                    (1 - b) * ((1 - a) * picture.at(x, y, c) + a * picture.at(x + 1, y, c)) +
                    b * ((1 - a) * picture.at(x, y + 1, c) + a * picture.at(x + 1, y + 1, c));
        });
        return out;
    }

    /// Position in the photograph of the pinhole's `pixel`; empty: none.
    std::optional<Vec2<double>> find(Vec2f pixel) const {
        Vec2<double> place{double(pixel.x), double(pixel.y)};
        if (places_.empty() || find_in_photo(in_, place.x, place.y, place)) return place;
        return std::nullopt;
    }

private:
    /// The pinhole's position of `place` in the photograph.
    Vec2<double> undistorted_place(Vec2<double> place) const {
        const Vec2<double> uv = undistort(
            in_.distortion, {(place.x - in_.cx_px) / in_.fx_px, (place.y - in_.cy_px) / in_.fy_px});
        return {uv.x * in_.fx_px + in_.cx_px, uv.y * in_.fy_px + in_.cy_px};
    }

    int samples_;
    Intrinsics in_;
    std::string colmap_;
    std::vector<Vec2<double>> places_;  // empty: a pinhole
    Vec2<double> low_, high_;
};

}  // namespace tvsgs::synth
