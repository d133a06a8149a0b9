#include "apps/prepare/control_points.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <ranges>

#include "core/log.h"
#include "core/math/quantile.h"
#include "io/files/read_file.h"

namespace tvsgs::prepare {
namespace {

Error wrong(const ControlList& list, int line, const std::string& what) {
    return input_error(list.path, ":", line, ": ", what);
}

/// The photograph that a mark names by its path or the end of its path.
const Photograph& photograph_of(const ControlList& list,
                                const ControlMark& mark,
                                const std::vector<Photograph>& photographs) {
    std::vector<const Photograph*> found;
    for (const Photograph& photo : photographs) {
        if (photo.name == mark.image) return photo;
        if (("/" + photo.file).ends_with("/" + mark.image)) found.push_back(&photo);
    }
    if (found.empty())
        throw wrong(list, mark.line,
                    str("no photograph '", shown(mark.image), "'; expected one of the ",
                        photographs.size(), " files, such as ", photographs.front().name));
    if (found.size() > 1)
        throw wrong(list, mark.line,
                    str("'", shown(mark.image), "' may be ", found[0]->name, " or ", found[1]->name,
                        "; expected the path below the folder"));
    return *found[0];
}

void match_marks(ControlList& list, const std::vector<Photograph>& photographs) {
    for (ControlPoint& point : list.points) {
        std::map<std::string, int> lines;
        for (ControlMark& mark : point.marks) {
            const Photograph& photo = photograph_of(list, mark, photographs);
            const Vec2<double> p = mark.place;
            if (!(p.x >= 0 && p.x <= photo.width && p.y >= 0 && p.y <= photo.height))
                throw wrong(list, mark.line,
                            str("px py ", p.x, " ", p.y, " lies outside of ", photo.name, ", ",
                                photo.width, "x", photo.height,
                                " pixels; expected pixels of this file as it is stored: was it "
                                "resized, or turned by its EXIF orientation?"));
            mark.image = photo.name;
            if (const auto [at, is_new] = lines.emplace(mark.image, mark.line); !is_new)
                throw wrong(list, mark.line,
                            str("'", shown(point.name), "' is marked in ", mark.image, " in line ",
                                at->second, " already; expected one mark for each photograph"));
        }
    }
}

/// Degrees become metres in a local frame.
void make_metric(ControlList& list) {
    if (!list.degrees) return;
    std::vector<GeodeticPlace> places;
    for (const ControlPoint& point : list.points)
        places.push_back({point.position.y, point.position.x, point.position.z});
    const LocalFrame frame(places);
    for (std::size_t i = 0; i < places.size(); ++i) list.points[i].position = frame(places[i]);
    list.projection = frame.projection();
    list.degrees = false;
}

std::set<std::string> checkpoints_of(const std::string& names, const ControlList& list) {
    std::set<std::string> out;
    for (std::size_t begin = 0; begin <= names.size();) {
        const std::size_t end = std::min(names.find(',', begin), names.size());
        const std::string name(trimmed(std::string_view(names).substr(begin, end - begin)));
        begin = end + 1;
        if (name.empty()) continue;
        if (std::ranges::find(list.points, name, &ControlPoint::name) == list.points.end())
            throw Error(ExitCode::usage, "--checkpoints: ", list.path, " has no point '", name,
                        "'; expected names of ",
                        joined(list.points | std::views::transform(&ControlPoint::name)));
        out.insert(name);
    }
    return out;
}

/// One mark with the camera of its photograph.
struct MarkedRay {
    Ray ray;
    const Intrinsics* camera;
    Rigid3d camera_from_world;
    Vec2<double> place;
    int line;

    double miss_px(Vec3d point) const {
        const auto at = pixel_of(*camera, camera_from_world, point);
        if (!at) return std::numeric_limits<double>::infinity();
        const Vec2<double> d = *at - place;
        return std::sqrt(dot(d, d));
    }
    /// Farther off, a mark shows another point: 12 px of 4,000.
    double limit_px() const { return 0.003 * std::max(camera->width_px, camera->height_px); }
    bool supports(Vec3d point) const { return miss_px(point) <= limit_px(); }
};

std::optional<Vec3d> meeting_point_of(const std::vector<const MarkedRay*>& marks) {
    std::vector<Ray> rays;
    for (const MarkedRay* mark : marks) rays.push_back(mark->ray);
    return meeting_point(rays);
}

/// The marks that support the point of the best pair.
std::vector<const MarkedRay*> best_marks(const std::vector<MarkedRay>& marks) {
    std::vector<const MarkedRay*> best;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < marks.size(); ++i)
        for (std::size_t j = i + 1; j < marks.size(); ++j) {
            const auto point = meeting_point({marks[i].ray, marks[j].ray});
            if (!point) continue;
            std::vector<const MarkedRay*> support;
            double sum = 0;
            for (const MarkedRay& mark : marks)
                if (mark.supports(*point))
                    support.push_back(&mark), sum += std::pow(mark.miss_px(*point), 2);
            if (support.size() < 2 || support.size() < best.size()) continue;
            if (support.size() == best.size() && !(sum < least)) continue;
            best = support, least = sum;
        }
    return best;
}

double rms(double squared, std::size_t count) {
    return count > 0 ? std::sqrt(squared / static_cast<double>(count)) : 0;
}

/// In millimetres, without a negative zero.
double shown_m(double metres) {
    return std::round(1000 * metres) / 1000 + 0.0;
}

/// Metres per unit: the median over pairs of points.
double rough_scale(const std::vector<Vec3d>& model, const std::vector<Vec3d>& world) {
    std::vector<double> ratios;
    for (std::size_t i = 0; i < model.size(); ++i)
        for (std::size_t j = i + 1; j < model.size(); ++j)
            if (const double length = norm(model[i] - model[j]); length > 0)
                ratios.push_back(norm(world[i] - world[j]) / length);
    return quantile(ratios, 0.5);
}

/// Flat points fit a mirrored frame upside down.
void warn_if_upside_down(const SparseModel& model,
                         const Similarity& to_world,
                         const std::string& path) {
    double sum = 0;
    for (const SparseImage& image : model.images) {
        const Mat3<double> R = image.camera_from_world().R * transpose(to_world.R);
        sum -= R[1][2] + R[2][2];  // up on the image; back from the scene
    }
    if (sum < 0)
        spdlog::warn(
            "The cameras look at the scene from below: are x (east) and y (north) swapped in {}?",
            path);
}

}  // namespace

ControlPoints read_control_points(const std::string& path,
                                  const std::vector<Photograph>& photographs,
                                  const std::string& checkpoints) {
    ControlPoints out{read_control_list(path), {}};
    out.checkpoints = checkpoints_of(checkpoints, out.list);
    match_marks(out.list, photographs);
    make_metric(out.list);
    std::vector<Vec3d> places;
    for (const ControlPoint& point : out.list.points)
        if (point.marks.size() > 1 && !out.checkpoints.contains(point.name))
            places.push_back(point.position);
    if (places.size() < 3)
        throw input_error(
            path, ": ", places.size(), " points to fit with marks in two or more photographs",
            out.checkpoints.empty() ? "" : ", without checkpoints", "; expected at least 3");
    require_rotation(places, {}, path);
    return out;
}

FoundPoint find_point(const SparseModel& model, const ControlPoint& point) {
    std::map<std::uint32_t, Intrinsics> cameras;
    std::vector<MarkedRay> marks;
    for (const ControlMark& mark : point.marks) {
        const auto image = std::ranges::find(model.images, mark.image, &SparseImage::name);
        if (image == model.images.end()) continue;
        const SparseCamera& camera = model.camera(image->camera_id);
        const Intrinsics& in = cameras.try_emplace(camera.id, intrinsics_of(camera)).first->second;
        const Rigid3d pose = image->camera_from_world();
        marks.push_back({ray_of(in, pose, mark.place), &in, pose, mark.place, mark.line});
    }
    FoundPoint out;
    const std::vector<const MarkedRay*> good = best_marks(marks);
    out.position = meeting_point_of(good);
    if (!out.position) return out;
    double squared = 0;
    for (const MarkedRay& mark : marks) {
        if (std::ranges::find(good, &mark) == good.end()) {
            out.dropped.push_back(mark.line);
            continue;
        }
        out.used.push_back(mark.line);
        squared += std::pow(mark.miss_px(*out.position), 2);
        out.pixel += norm(*out.position - mark.ray.origin) / mark.camera->fx_px;
    }
    out.residual_px = rms(squared, good.size());
    out.pixel /= static_cast<double>(good.size());
    return out;
}

GeoFrame place_by_control_points(const SparseModel& model, const ControlPoints& points) {
    const ControlList& list = points.list;
    std::vector<FoundPoint> found;
    std::vector<Vec3d> from, to;
    std::vector<double> pixels;
    std::vector<std::size_t> pair_of;  // by point
    for (const ControlPoint& point : list.points) {
        found.push_back(find_point(model, point));
        pair_of.push_back(from.size());
        if (!found.back().position)
            spdlog::warn(
                "{}: not used: fewer than two of its {} marks meet, in photographs with a pose",
                point.name, point.marks.size());
        if (!found.back().position || points.checkpoints.contains(point.name)) continue;
        from.push_back(*found.back().position), to.push_back(point.position);
        pixels.push_back(found.back().pixel);
    }
    // Marks are right to a few pixels; a smaller residual makes no outlier.
    constexpr double kMarkPx = 5;
    const double tolerance = kMarkPx * quantile(pixels, 0.5) * rough_scale(from, to);
    const Fit fit = fit_without_outliers(from, to, tolerance, list.path);
    GeoFrame out = geo_frame(fit, list.projection);

    JsonValue lines = JsonValue::list();
    double check_squared = 0, largest = 0;
    std::size_t checks = 0, fitted = 0;
    std::string worst;
    for (std::size_t i = 0; i < list.points.size(); ++i) {
        const ControlPoint& point = list.points[i];
        const FoundPoint& f = found[i];
        const bool check = points.checkpoints.contains(point.name);
        JsonValue line;
        line.add("name", point.name);
        if (!f.position) {
            lines.items.push_back(line.add("use", "none"));
            continue;
        }
        const Vec3d miss = fit.world_from_model * *f.position - point.position;
        const bool outlier = !check && !fit.inlier[pair_of[i]];
        const char* use = check ? "checkpoint" : outlier ? "outlier" : "fitted";
        const std::string text = fmt::format(
            "{}: east {:.3f}, north {:.3f}, up {:.3f} m; {} marks, {:.1f} px", point.name,
            shown_m(miss.x), shown_m(miss.y), shown_m(miss.z), f.used.size(), f.residual_px);
        if (outlier)
            spdlog::warn("{}: left out, an outlier: check its coordinates", text);
        else
            spdlog::info("{}{}", text, check ? " (checkpoint)" : "");
        for (const int dropped : f.dropped)
            spdlog::warn("{}:{}: mark of {} left out: does not meet the other marks", list.path,
                         dropped, point.name);
        if (check) check_squared += dot(miss, miss), ++checks;
        if (!check && !outlier) {
            ++fitted;
            if (norm(miss) >= largest) largest = norm(miss), worst = point.name;
        }
        lines.items.push_back(
            line.add("use", use)
                .add("error_m",
                     std::vector{rounded(miss.x, 4), rounded(miss.y, 4), rounded(miss.z, 4)})
                .add("marks", f.used.size())
                .add("residual_px", rounded(f.residual_px, 4)));
    }
    spdlog::info("Control points: {} fitted, residual {:.3f} m (RMS), largest {:.3f} m ({})",
                 fitted, fit.rmse, largest, worst);
    if (checks > 0) {
        const double rmse = rms(check_squared, checks);
        spdlog::info("Checkpoints: {}, residual {:.3f} m (RMS)", checks, rmse);
        out.report.add("checkpoint_rmse_m", rounded(rmse, 4));
    }
    check_fit(fit, from, to, list.path);
    out.report.add("points", lines);
    warn_if_upside_down(model, out.to_world, list.path);
    return out;
}

}  // namespace tvsgs::prepare
