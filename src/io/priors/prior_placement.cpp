#include "io/priors/prior_placement.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/device/parallel.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

/// True if a map of w x h can show a whole image of the given size: up to 1 %, a pixel of rounding,
/// or the nearest multiple of 14 or 32 to which networks stretch their input.
bool same_shape(double w, double h, double width, double height) {
    const double wanted_h = w * height / width, wanted_w = h * width / height;
    double slack = 1;
    for (const double patch : {14.0, 32.0})
        if (std::fmod(w, patch) == 0 && std::fmod(h, patch) == 0) slack = patch / 2;
    return std::abs(wanted_h - h) <= std::max(0.01 * h, slack) ||
           std::abs(wanted_w - w) <= std::max(0.01 * w, slack);
}

}  // namespace

PhotoWindow centre_square(const View& view) {
    const double width = view.photo.width * view.reduction,
                 height = view.photo.height * view.reduction, side = std::min(width, height);
    return {(width - side) / 2, (height - side) / 2, side, side};
}

MapPlacement::MapPlacement(const std::string& path,
                           const View& view,
                           const std::optional<Intrinsics>& camera,
                           const std::optional<PhotoWindow>& window,
                           const ImageF& map)
    : width_(map.width), height_(map.height) {
    const double width = view.photo.width, height = view.photo.height;
    const PhotoWindow all{0, 0, width * view.reduction, height * view.reduction};
    const PhotoWindow shown = window.value_or(all);
    if (!same_shape(map.width, map.height, shown[2], shown[3]))
        throw input_error("E_PRIOR_SIZE: ", path, ": ", map.width, "x", map.height, " pixels; ",
                          window ? "its window of the photograph has " : "its photograph has ",
                          std::lround(shown[2]), "x", std::lround(shown[3]),
                          same_shape(map.height, map.width, shown[2], shown[3])
                              ? " (turned, as by EXIF orientation)"
                              : "",
                          "; expected that shape: make the map from the whole photograph, or give "
                          "the window of a depth map as \"crop\" in priors.json");
    scale_x_ = view.reduction * map.width / shown[2];
    scale_y_ = view.reduction * map.height / shown[3];
    offset_x_ = -shown[0] * map.width / shown[2];
    offset_y_ = -shown[1] * map.height / shown[3];
    if (camera) camera_ = scaled(*camera, view.photo.width, view.photo.height);
}

bool MapPlacement::find(double x, double y, double& u, double& v) const {
    Vec2<double> place{x, y};
    if (camera_ && !find_in_photo(*camera_, x, y, place)) return false;
    u = scale_x_ * place.x + offset_x_;
    v = scale_y_ * place.y + offset_y_;
    return u >= 0 && v >= 0 && u <= width_ && v <= height_;
}

bool sample_map(const ImageF& map, MapBlend blend, double u, double v, float* values) {
    const int channels = map.channels;
    const auto has_value = [&](const float* pixel) {
        return std::none_of(pixel, pixel + channels, [](float n) { return std::isnan(n); });
    };
    const int x = std::clamp(static_cast<int>(u), 0, map.width - 1),
              y = std::clamp(static_cast<int>(v), 0, map.height - 1);
    const float* const holding = &map.at(x, y);
    if (!has_value(holding)) return false;
    std::copy_n(holding, channels, values);
    if (blend == MapBlend::nearest) return true;

    // The four neighbouring pixel centres; repeats the border.
    const double qx = std::clamp(u - 0.5, 0.0, map.width - 1.0),
                 qy = std::clamp(v - 0.5, 0.0, map.height - 1.0);
    const int x0 = static_cast<int>(qx), y0 = static_cast<int>(qy),
              x1 = std::min(x0 + 1, map.width - 1), y1 = std::min(y0 + 1, map.height - 1);
    const float* const corners[4] = {&map.at(x0, y0), &map.at(x1, y0), &map.at(x0, y1),
                                     &map.at(x1, y1)};
    if (!std::all_of(corners, corners + 4, has_value)) return true;
    const double a = qx - x0, b = qy - y0;
    const double weights[4] = {(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b};
    for (int c = 0; c < channels; ++c) {
        const bool inverse =
            blend == MapBlend::inverse &&
            std::all_of(corners, corners + 4, [c](const float* corner) { return corner[c] > 0; });
        double sum = 0;
        for (int i = 0; i < 4; ++i) {
            const double value = static_cast<double>(corners[i][c]);
            sum += weights[i] * (inverse ? 1 / value : value);
        }
        values[c] = static_cast<float>(inverse ? 1 / sum : sum);
    }
    return true;
}

ImageF resample_map(const ImageF& map,
                    const MapPlacement& placement,
                    const View& view,
                    int width,
                    int height,
                    MapBlend blend) {
    ImageF out(width, height, map.channels, std::numeric_limits<float>::quiet_NaN());
    const double step_x = static_cast<double>(view.photo.width) / width,
                 step_y = static_cast<double>(view.photo.height) / height;
    parallel_for_heavy(Cpu{}, height, [&](int y) {
        for (int x = 0; x < width; ++x) {
            double u = 0, v = 0;
            if (placement.find((x + 0.5) * step_x, (y + 0.5) * step_y, u, v))
                sample_map(map, blend, u, v, &out.at(x, y));
        }
    });
    return out;
}

}  // namespace tvsgs
