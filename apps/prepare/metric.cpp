#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "apps/prepare/placement.h"
#include "io/files/read_file.h"

namespace tvsgs::prepare {
namespace {

struct Square {
    Vec3d corners[4];  // clockwise from the upper left, seen from the printed side
    double sides[4];

    Vec3d right() const { return corners[1] - corners[0] + corners[2] - corners[3]; }
    Vec3d down() const { return corners[3] - corners[0] + corners[2] - corners[1]; }
    Vec3d out() const { return cross(down(), right()); }
    Vec3d middle() const { return 0.25 * (corners[0] + corners[1] + corners[2] + corners[3]); }
};

std::optional<Square> square_of(const std::vector<Ray> (&rays)[4]) {
    Square square;
    for (int i = 0; i < 4; ++i) {
        const std::optional<Vec3d> corner = meeting_point(rays[i]);
        if (!corner) return std::nullopt;
        square.corners[i] = *corner;
    }
    for (int i = 0; i < 4; ++i)
        square.sides[i] = norm(square.corners[(i + 1) % 4] - square.corners[i]);
    const auto [least, most] = std::minmax_element(square.sides, square.sides + 4);
    return *most <= 1.1 * *least ? std::optional(square) : std::nullopt;
}

}  // namespace

MetricFrame metric_frame(const std::vector<MarkerView>& views, double size, bool on_wall) {
    std::map<int, std::vector<Ray>[4]> seen;
    for (const MarkerView& view : views)
        for (const Marker& marker : view.markers)
            for (int i = 0; i < 4; ++i)
                seen[marker.id][i].push_back(
                    ray_of(view.camera, view.camera_from_world, marker.corners[i]));
    std::map<int, Square> squares;
    for (const auto& [id, rays] : seen)
        if (const std::optional<Square> square = square_of(rays)) squares.emplace(id, *square);
    if (squares.empty())
        throw input_error("--marker-size: ", seen.size(), " markers in ", views.size(),
                          " photographs, none of them seen from two places; expected at least one: "
                          "does --marker-dictionary match the print?");

    MetricFrame frame;
    frame.markers = static_cast<int>(squares.size());
    std::vector<double> sides;
    for (const auto& [id, square] : squares)
        sides.insert(sides.end(), square.sides, square.sides + 4);
    std::ranges::sort(sides);
    const double middle = 0.5 * (sides[sides.size() / 2] + sides[(sides.size() - 1) / 2]);
    double squared = 0;
    for (const double side : sides) squared += (side - middle) * (side - middle);
    frame.spread = std::sqrt(squared / static_cast<double>(sides.size())) / middle;
    frame.to_new.scale = size / middle;

    const auto up_of = [&](const Square& square) {
        return normalize(on_wall ? -square.down() : square.out());
    };
    Vec3d up{};
    for (const auto& [id, square] : squares) up += up_of(square);
    up = normalize(up);
    constexpr double kCosine = 0.9659;  // 15 degrees
    frame.upright = std::ranges::all_of(
        squares, [&](const auto& entry) { return dot(up_of(entry.second), up) >= kCosine; });
    if (!frame.upright) return frame;
    const Square& first = squares.begin()->second;
    const Vec3d y = normalize(cross(up, first.right())), x = cross(y, up);
    Mat3<double>& R = frame.to_new.R;
    for (int c = 0; c < 3; ++c) R[0][c] = x[c], R[1][c] = y[c], R[2][c] = up[c];
    frame.to_new.t = -(frame.to_new.scale * (R * first.middle()));
    return frame;
}

}  // namespace tvsgs::prepare
