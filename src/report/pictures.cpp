#include "report/pictures.h"

#include <algorithm>
#include <cmath>

#include "eval/error_colors.h"
#include "eval/mesh_metrics.h"
#include "io/image_file.h"
#include "render/sh_math.h"

namespace tvsgs {
namespace {

constexpr std::size_t kMaxPoints = 40000;
constexpr double kFullDifference = 0.25;
constexpr int kPictureWidth = 640, kPictureHeight = 480;
constexpr float kEyeDistance = 2.6f, kFocal = 2.4f;  // in radii; page.h has the same

std::uint8_t byte_of(double value) {
    return static_cast<std::uint8_t>(std::clamp(std::lround(255 * value), 0L, 255L));
}

Rgb cividis(double share) {
    const Vec3f c = error_color(ErrorPalette::safe, share, 1, PointFate::measured);
    return {byte_of(static_cast<double>(c.x)), byte_of(static_cast<double>(c.y)),
            byte_of(static_cast<double>(c.z))};
}

/// Centre and radius of what is worth looking at: strays, a hundredth on each side, do not count.
struct Ball {
    Vec3f centre;
    float radius;
};
Ball ball_around(const std::vector<Vec3f>& points) {
    Ball ball{{}, 0};
    std::vector<float> values(points.size());
    const auto at_share = [&](double share) {
        const auto nth = values.begin() + static_cast<std::ptrdiff_t>(
                                              share * static_cast<double>(values.size() - 1));
        std::nth_element(values.begin(), nth, values.end());
        return *nth;
    };
    for (int a = 0; a < 3; ++a) {
        for (std::size_t i = 0; i < points.size(); ++i) values[i] = points[i][a];
        const float low = at_share(0.01);
        ball.centre[a] = 0.5f * (low + at_share(0.99));
    }
    for (std::size_t i = 0; i < points.size(); ++i) values[i] = norm(points[i] - ball.centre);
    ball.radius = std::max(at_share(0.99), 1e-20f);
    return ball;
}

struct Shown {
    std::vector<Vec3f> positions;  // in the viewer's frame, in radii
    std::vector<Rgb> colors;
};

ImageU8 picture_of(const Shown& points, float pitch) {
    ImageU8 image(kPictureWidth, kPictureHeight, 3, 16);
    std::vector<float> nearest(static_cast<std::size_t>(kPictureWidth) * kPictureHeight, 1e30f);
    const float c = std::cos(pitch), s = std::sin(pitch);
    for (std::size_t i = 0; i < points.positions.size(); ++i) {
        const Vec3f p = points.positions[i];
        const float y = c * p.y - s * p.z, z = s * p.y + c * p.z, depth = kEyeDistance - z;
        if (!(depth > 0.05f)) continue;
        const float scale = kFocal * 0.5f * kPictureHeight / depth;
        const int px = static_cast<int>(std::floor(0.5f * kPictureWidth + scale * p.x)),
                  py = static_cast<int>(std::floor(0.5f * kPictureHeight - scale * y));
        for (int v = std::max(py - 1, 0); v <= std::min(py + 1, kPictureHeight - 1); ++v)
            for (int u = std::max(px - 1, 0); u <= std::min(px + 1, kPictureWidth - 1); ++u) {
                float& before = nearest[static_cast<std::size_t>(v) * kPictureWidth + u];
                if (depth >= before) continue;
                before = depth;
                image.at(u, v, 0) = points.colors[i].r;
                image.at(u, v, 1) = points.colors[i].g;
                image.at(u, v, 2) = points.colors[i].b;
            }
    }
    return image;
}

}  // namespace

std::string base64(const std::string& bytes) {
    static const char* const digits =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string out;
    out.reserve(bytes.size() / 3 * 4 + 4);
    for (std::size_t i = 0; i < bytes.size(); i += 3) {
        const auto at = [&](std::size_t j) {
            return j < bytes.size() ? static_cast<unsigned char>(bytes[j]) : 0u;
        };
        const unsigned bits = at(i) << 16 | at(i + 1) << 8 | at(i + 2);
        out += digits[bits >> 18];
        out += digits[bits >> 12 & 63];
        out += i + 1 < bytes.size() ? digits[bits >> 6 & 63] : '=';
        out += i + 2 < bytes.size() ? digits[bits & 63] : '=';
    }
    return out;
}

JsonValue picture_json(const ImageU8& image, int width) {
    const int w = std::min(width, image.width);
    const int h = std::max(
        1, static_cast<int>(std::lround(static_cast<double>(image.height) * w / image.width)));
    JsonValue json = JsonValue::object();
    json.set("src",
             "data:image/jpeg;base64," + base64(jpeg_bytes(resize_bicubic(image, w, h), 85)));
    json.set("width", w);
    json.set("height", h);
    return json;
}

Rgb error_shade(double share) {
    return cividis(0.2 + 0.8 * std::clamp(share, 0.0, 1.0));
}

ImageU8 difference_image(const ImageU8& a, const ImageU8& b) {
    ImageU8 out(a.width, a.height, 3);
    for (int y = 0; y < a.height; ++y)
        for (int x = 0; x < a.width; ++x) {
            int sum = 0;
            for (int c = 0; c < 3; ++c) sum += std::abs(a.at(x, y, c) - b.at(x, y, c));
            const Rgb shade = cividis(sum / (3 * 255 * kFullDifference));
            out.at(x, y, 0) = shade.r, out.at(x, y, 1) = shade.g, out.at(x, y, 2) = shade.b;
        }
    return out;
}

Viewpoint viewpoint_of(const JsonValue& cameras) {
    Viewpoint view;
    // "rotation" is world_from_camera; its columns are right, down and forward.
    const auto column = [](const JsonValue& camera, int c) {
        Vec3f v{};
        const auto& rows = camera["rotation"].items;
        for (int r = 0; r < 3 && rows.size() == 3 && rows[0].items.size() == 3; ++r)
            v[r] = static_cast<float>(
                rows[static_cast<std::size_t>(r)].items[static_cast<std::size_t>(c)].number);
        return v;
    };
    if (cameras.items.empty()) return view;
    Vec3f up{};
    for (const JsonValue& camera : cameras.items) up = up - column(camera, 1);
    const Vec3f forward = column(cameras.items[cameras.items.size() / 2], 2);
    if (!(norm(up) > 1e-6f)) up = -column(cameras.items.front(), 1);
    up = (1 / norm(up)) * up;
    const float rise = dot(forward, up);
    Vec3f back = rise * up - forward;  // level, towards the viewer
    if (!(norm(up) > 0.5f && norm(back) > 1e-3f)) return view;
    back = (1 / norm(back)) * back;
    const Vec3f right = cross(up, back);
    for (int a = 0; a < 3; ++a)
        view.axes[0][a] = right[a], view.axes[1][a] = up[a], view.axes[2][a] = back[a];
    view.pitch = std::asin(std::clamp(-rise, -1.0f, 1.0f));
    return view;
}

PointCloud centres_of(const Gaussians<Cpu>& splats) {
    PointCloud cloud;
    cloud.positions.assign(splats.means.data(), splats.means.data() + splats.means.size());
    for (std::size_t i = 0; i < splats.means.size(); ++i)
        cloud.colors.push_back(Vec3f{0.5f, 0.5f, 0.5f} + static_cast<float>(kShC0) * splats.sh[i]);
    return cloud;
}

double full_error(const Truth& truth) {
    double full = 0;
    for (const double tau : truth.taus) full = std::max(full, 2 * tau);
    return full;
}

JsonValue points_json(const PointCloud& points,
                      const std::optional<Truth>& truth,
                      const Viewpoint& viewpoint) {
    std::vector<std::size_t> chosen;
    for (std::size_t i = 0; i < points.positions.size(); ++i) {
        const Vec3f p = points.positions[i];
        if (is_finite(p) &&
            (!truth || contains(truth->crop, vec_cast<double>(p) + truth->measure.origin)))
            chosen.push_back(i);
    }
    const std::size_t candidates = chosen.size();
    if (candidates == 0) return {};
    if (candidates > kMaxPoints) {
        // One of each run of neighbours, by chance: a fixed one shows as stripes on meshes.
        for (std::size_t i = 0; i < kMaxPoints; ++i) {
            const std::size_t first = i * candidates / kMaxPoints,
                              next = (i + 1) * candidates / kMaxPoints;
            chosen[i] = chosen[first + (i * 2654435761u >> 8) % (next - first)];
        }
        chosen.resize(kMaxPoints);
    }
    std::vector<Vec3f> centres;
    for (const std::size_t i : chosen) centres.push_back(points.positions[i]);
    std::vector<double> errors;
    double full = 0;
    if (truth) {
        errors = truth->surface.to.distances(all_points(centres).points);
        full = full_error(*truth);
    }
    const Ball ball = ball_around(centres);

    std::string positions, colors, levels;
    Shown shown;
    for (std::size_t i = 0; i < chosen.size(); ++i) {
        const Vec3f p = (1 / ball.radius) * (viewpoint.axes * (centres[i] - ball.centre));
        if (!(norm(p) < 3)) continue;  // strays; 16 bits hold this range
        for (int a = 0; a < 3; ++a) {
            const auto q = static_cast<std::uint16_t>(std::lround(10000 * p[a]));
            positions += static_cast<char>(q & 255);
            positions += static_cast<char>(q >> 8);
        }
        const Vec3f own =
            points.colors.empty() ? Vec3f{0.5f, 0.5f, 0.5f} : points.colors[chosen[i]];
        Rgb color{byte_of(static_cast<double>(own.x)), byte_of(static_cast<double>(own.y)),
                  byte_of(static_cast<double>(own.z))};
        for (const std::uint8_t channel : {color.r, color.g, color.b})
            colors += static_cast<char>(channel);
        if (truth) {
            const double share = full > 0 ? std::min(errors[i] / full, 1.0) : 0;
            levels += static_cast<char>(byte_of(share));
            color = error_shade(share);
        }
        shown.positions.push_back(p);
        shown.colors.push_back(color);
    }
    JsonValue json = JsonValue::object();
    json.set("shown", static_cast<double>(shown.positions.size()));
    json.set("of", static_cast<double>(points.positions.size()));
    json.set("in_crop", static_cast<double>(candidates));
    json.set("pitch", static_cast<double>(viewpoint.pitch));
    json.set("positions", base64(positions));
    json.set("colors", base64(colors));
    if (truth) {
        json.set("errors", base64(levels));
        json.set("full", full);
        std::string palette;
        for (int i = 0; i < 256; ++i) {
            const Rgb shade = error_shade(i / 255.0);
            for (const std::uint8_t channel : {shade.r, shade.g, shade.b})
                palette += static_cast<char>(channel);
        }
        json.set("palette", base64(palette));
    }
    json.set("picture", picture_json(picture_of(shown, viewpoint.pitch), kPictureWidth));
    return json;
}

}  // namespace tvsgs
