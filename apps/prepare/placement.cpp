#include "apps/prepare/placement.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>

#include "core/log.h"
#include "core/math/eigen.h"
#include "core/math/quantile.h"
#include "core/math/rng.h"
#include "eval/points.h"
#include "io/files/read_file.h"

namespace tvsgs::prepare {
namespace {

using Triple = std::array<std::size_t, 3>;

std::vector<Triple> triples_of(std::size_t n) {
    constexpr std::size_t kAll = 23;  // 1,771 triples
    constexpr int kDraws = 2000;      // with a third of outliers, three in ten have none
    std::vector<Triple> out;
    if (n <= kAll) {
        for (std::size_t i = 0; i < n; ++i)
            for (std::size_t j = i + 1; j < n; ++j)
                for (std::size_t k = j + 1; k < n; ++k) out.push_back({i, j, k});
        return out;
    }
    for (int draw = 0; draw < kDraws; ++draw) {
        const Random4 r =
            random4(0, RandomStream::ransac, static_cast<std::uint64_t>(draw), std::uint32_t{0});
        Triple t;
        for (std::size_t k = 0; k < 3; ++k)
            t[k] = static_cast<std::size_t>(std::uint64_t{r.v[k]} * n >> 32);
        if (t[0] != t[1] && t[1] != t[2] && t[0] != t[2]) out.push_back(t);
    }
    return out;
}

std::vector<double> residuals(const Affine3d& T,
                              const std::vector<Vec3d>& model,
                              const std::vector<Vec3d>& world) {
    std::vector<double> out;
    for (std::size_t i = 0; i < model.size(); ++i) out.push_back(norm(T * model[i] - world[i]));
    return out;
}

/// The `count`-th smallest value.
double ranked(std::vector<double> values, std::size_t count) {
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(count - 1);
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

template <class Value>
std::vector<Value> taken(const std::vector<Value>& values, const std::vector<bool>& which) {
    std::vector<Value> out;
    for (std::size_t i = 0; i < values.size(); ++i)
        if (which[i]) out.push_back(values[i]);
    return out;
}

// WGS84: half axis in metres, flattening.
constexpr double kAxis = 6378137, kFlattening = 1 / 298.257223563;
constexpr double kRadians = std::numbers::pi / 180;

/// From the centre of the Earth: x to longitude 0, z to the north pole.
Vec3d earth_centred(const GeodeticPlace& p) {
    constexpr double e2 = kFlattening * (2 - kFlattening);
    const double latitude = p.latitude_deg * kRadians, longitude = p.longitude_deg * kRadians;
    const double s = std::sin(latitude), c = std::cos(latitude);
    const double radius = kAxis / std::sqrt(1 - e2 * s * s);
    return {(radius + p.height_m) * c * std::cos(longitude),
            (radius + p.height_m) * c * std::sin(longitude), (radius * (1 - e2) + p.height_m) * s};
}

}  // namespace

void require_rotation(const std::vector<Vec3d>& places,
                      const std::vector<Vec3d>& errors,
                      const std::string& where) {
    const double n = static_cast<double>(places.size());
    const SymEigen3<double> spread = sym_eigen(second_moments(places));
    const double along = std::sqrt(std::max(spread.values.x, 0.0)),
                 across = std::sqrt(std::max(spread.values.y, 0.0));
    constexpr double kAcross = 0.02, kTurn = 0.17;
    if (!(across > kAcross * along))
        throw input_error(where, ": ", places.size(), " places on one line, ", rounded(along, 3),
                          " m along it and ", rounded(across, 3),
                          " m across (standard deviations): the rotation around it is unknown; "
                          "expected places to both sides of it");
    double squared = 0;
    for (const Vec3d e : errors) squared += std::pow(dot(e, column(spread.vectors, 2)), 2) / n;
    if (const double error = std::sqrt(squared); !(error < kTurn * across * std::sqrt(n)))
        throw input_error(where, ": the places do not fit the photographs: they spread ",
                          rounded(along, 3), " m and ", rounded(across, 3),
                          " m, with residuals of ", rounded(error, 3),
                          " m out of this plane; check coordinates, heights and marks");
}

void check_fit(const Fit& fit,
               const std::vector<Vec3d>& model,
               const std::vector<Vec3d>& world,
               const std::string& where) {
    std::vector<Vec3d> places, errors;
    for (std::size_t i = 0; i < model.size(); ++i)
        if (fit.inlier[i]) {
            places.push_back(fit.world_from_model * model[i]);
            errors.push_back(places.back() - world[i]);
        }
    require_rotation(places, errors, where);
    const Sym3<double> spread = second_moments(places);
    const double unknown = fit.rmse / std::sqrt((spread.xx + spread.yy + spread.zz) *
                                                static_cast<double>(places.size()));
    if (unknown > 0.01)
        spdlog::warn("{}: the residuals leave the scale unknown by about {:.0f} %", where,
                     100 * unknown);
}

Fit fit_without_outliers(const std::vector<Vec3d>& model,
                         const std::vector<Vec3d>& world,
                         double tolerance,
                         const std::string& where) {
    const std::size_t n = model.size();
    if (n < 3) throw input_error(where, ": ", n, " places to fit; expected at least 3");
    const std::size_t most = n == 3 ? 3 : n - std::max<std::size_t>(1, n / 3);
    std::optional<Affine3d> best;
    double least = std::numeric_limits<double>::infinity();
    for (const Triple& t : triples_of(n)) {
        const auto T = fit_similarity({model[t[0]], model[t[1]], model[t[2]]},
                                      {world[t[0]], world[t[1]], world[t[2]]});
        if (!T) continue;
        const double residual = ranked(residuals(*T, model, world), most);
        if (residual < least) least = residual, best = T;
    }
    if (!best) throw input_error(where, ": ", n, " places on one line; expected places beside it");
    // A fit through few pairs has small residuals by chance, so the limit is wider for them.
    const auto limit_of = [&](const std::vector<double>& r) {
        if (n == 3) return std::numeric_limits<double>::infinity();
        return std::max(tolerance, 2.5 * (1 + 5 / (static_cast<double>(n) - 3)) * ranked(r, most));
    };
    Fit fit{*best, {}, 0};
    constexpr int kRounds = 20;
    for (int round = 0; round < kRounds; ++round) {
        const std::vector<double> r = residuals(fit.world_from_model, model, world);
        const double limit = limit_of(r);
        std::vector<bool> inlier;
        for (const double residual : r) inlier.push_back(residual <= limit);
        if (inlier == fit.inlier) break;
        fit.inlier = inlier;
        if (const auto T = fit_similarity(taken(model, inlier), taken(world, inlier)))
            fit.world_from_model = *T;
    }
    const std::vector<double> r = taken(residuals(fit.world_from_model, model, world), fit.inlier);
    double squared = 0;
    for (const double residual : r) squared += residual * residual;
    fit.rmse = std::sqrt(squared / static_cast<double>(r.size()));
    return fit;
}

LocalFrame::LocalFrame(const std::vector<GeodeticPlace>& places) {
    const auto median = [&](double GeodeticPlace::*part, double unit) {
        std::vector<double> values;
        for (const GeodeticPlace& place : places) values.push_back(place.*part);
        if (part == &GeodeticPlace::longitude_deg)  // on both sides of the date line
            for (double& value : values) value = values[0] + std::remainder(value - values[0], 360);
        return unit * std::nearbyint(quantile(values, 0.5) / unit);
    };
    origin_ = {median(&GeodeticPlace::latitude_deg, 1e-7),
               median(&GeodeticPlace::longitude_deg, 1e-7), median(&GeodeticPlace::height_m, 0.01)};
    centre_ = earth_centred(origin_);
    const double latitude = origin_.latitude_deg * kRadians,
                 longitude = origin_.longitude_deg * kRadians;
    const double sa = std::sin(latitude), ca = std::cos(latitude), so = std::sin(longitude),
                 co = std::cos(longitude);
    local_from_earth_ = {{{-so, co, 0}, {-sa * co, -sa * so, ca}, {ca * co, ca * so, sa}}};
}

Vec3d LocalFrame::operator()(const GeodeticPlace& place) const {
    return local_from_earth_ * (earth_centred(place) - centre_);
}

std::string LocalFrame::projection() const {
    return fmt::format(
        "+proj=pipeline +step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 "
        "+lat_0={:.7f} +lon_0={:.7f} +h_0={:.2f}",
        origin_.latitude_deg, origin_.longitude_deg, origin_.height_m);
}

GeoFrame geo_frame(const Fit& fit, std::string projection) {
    GeoFrame out;
    const double scale = scale_of(fit.world_from_model);
    out.to_world = {scale, fit.world_from_model.A, fit.world_from_model.t};
    for (auto& row : out.to_world.R.m)
        for (double& entry : row) entry /= scale;
    out.report.add("projection", projection)
        .add("scale", scale)
        .add("rmse_m", rounded(fit.rmse, 4));
    out.projection = std::move(projection);
    return out;
}

void require_places(const std::vector<Photograph>& photographs, const std::string& folder) {
    std::size_t count = 0;
    for (const Photograph& photo : photographs) count += photo.place.has_value();
    if (count < 3)
        throw input_error(
            "--gps: ", count, " of the ", photographs.size(), " photographs in ", folder,
            " have a place in EXIF (latitude, longitude and altitude); expected at least 3");
}

GeoFrame place_by_exif(const SparseModel& model, const std::vector<Photograph>& photographs) {
    std::map<std::string, GeodeticPlace> place_of;
    for (const Photograph& photo : photographs)
        if (photo.place) place_of.emplace(photo.name, *photo.place);
    std::vector<std::string> names;
    std::vector<Vec3d> centres, world;
    std::vector<GeodeticPlace> places;
    for (const SparseImage& image : model.images)
        if (const auto found = place_of.find(image.name); found != place_of.end()) {
            names.push_back(image.name);
            centres.push_back(inverse(image.camera_from_world()).t);
            places.push_back(found->second);
        }
    if (places.size() < 3)
        throw input_error("--gps: ", places.size(),
                          " photographs have a pose and a place in EXIF; expected at least 3");
    const LocalFrame frame(places);
    for (const GeodeticPlace& place : places) world.push_back(frame(place));
    constexpr double kTolerance = 0.1;  // metres; receivers with corrections reach 0.03
    const Fit fit = fit_without_outliers(centres, world, kTolerance, "--gps");
    JsonValue cameras = JsonValue::list();
    std::size_t outliers = 0;
    std::string first;
    for (std::size_t i = 0; i < names.size(); ++i) {
        const Vec3d miss = fit.world_from_model * centres[i] - world[i];
        cameras.items.push_back(
            JsonValue()
                .add("image", names[i])
                .add("use", fit.inlier[i] ? "fitted" : "outlier")
                .add("error_m",
                     std::vector{rounded(miss.x, 4), rounded(miss.y, 4), rounded(miss.z, 4)}));
        if (!fit.inlier[i] && ++outliers == 1) first = names[i];
    }
    spdlog::info("Places of {} cameras by EXIF: residual {:.3g} m (RMS)", names.size() - outliers,
                 fit.rmse);
    if (outliers > 0)
        spdlog::warn("The EXIF places of {} photographs, such as {}, do not fit and are not used",
                     outliers, first);
    check_fit(fit, centres, world, "--gps");
    GeoFrame out = geo_frame(fit, frame.projection());
    out.report.add("cameras", cameras);
    return out;
}

}  // namespace tvsgs::prepare
