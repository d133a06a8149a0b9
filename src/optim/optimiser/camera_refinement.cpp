#include "optim/optimiser/camera_refinement.h"

#include <array>
#include <cmath>

#include "core/error.h"
#include "optim/views/matchable.h"

namespace tvsgs {
namespace {

constexpr double kBeta1 = 0.9, kBeta2 = 0.99, kEps = 1e-12;
constexpr std::size_t kPoints = 4000;  // sample of the initial cloud, for the depth of a view

double dot_of(const std::vector<double>& a, const double* b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
    return sum;
}
void add_scaled(double* to, double scale, const std::vector<double>& from) {
    for (std::size_t i = 0; i < from.size(); ++i) to[i] += scale * from[i];
}

Vec3d vec_at(const double* x) {
    return {x[0], x[1], x[2]};
}

using Sym6 = std::array<std::array<double, 6>, 6>;

/// Inner product of motions of a view by how they move images, averaged over pixels and three
/// depths: a rotation and a translation that cancel each other in the image count as no motion.
Sym6 image_metric(const Camera& c, double f, double depth) {
    Sym6 H{};
    constexpr int kSteps = 5;
    for (const double z : {0.8 * depth, depth, 1.25 * depth})
        for (int i = 0; i < kSteps * kSteps; ++i) {
            const double u = ((i % kSteps + 0.5) / kSteps * c.width_px - double(c.cx_px)) /
                             double(c.fx_px),
                         v = ((i / kSteps + 0.5) / kSteps * c.height_px - double(c.cy_px)) /
                             double(c.fy_px);
            double x[6], y[6];
            for (int k = 0; k < 6; ++k) {
                Vec3d e{};
                e[k % 3] = 1 / f;
                const Vec3d by = k < 3 ? cross(e, Vec3d{u * z, v * z, z}) : depth * e;
                x[k] = f / z * (by.x - u * by.z), y[k] = f / z * (by.y - v * by.z);
            }
            for (std::size_t r = 0; r < 6; ++r)
                for (std::size_t k = 0; k < 6; ++k)
                    H[r][k] += (x[r] * x[k] + y[r] * y[k]) / (3 * kSteps * kSteps);
        }
    return H;
}

void shorten(double* x, double most) {
    const double length = norm(vec_at(x));
    if (length > most)
        for (int k = 0; k < 3; ++k) x[k] *= most / length;
}

}  // namespace

CameraRefinement::CameraRefinement(const Scene& scene, const CameraOptions& options)
    : options_(options) {
    for (const View& view : scene.train) {
        const Camera& c = view.camera;
        given_.push_back(c);
        const double f = 0.5 * (double(c.fx_px) + double(c.fy_px));
        const std::vector<Vec3f>& points = scene.points.positions;
        const double depth =
            depth_of_view(c, points, std::max<std::size_t>(1, points.size() / kPoints));
        scale_.push_back({f, depth > 0 ? depth : 1});
    }
    cameras_ = given_;
    numbers_.assign(3 * parameters() + 1, 0);
    find_gauge();
}

void CameraRefinement::find_gauge() {
    std::vector<Sym6> metrics;
    for (std::size_t i = 0; i < given_.size(); ++i)
        metrics.push_back(image_metric(given_[i], scale_[i].f, scale_[i].depth));
    const auto dual = [&](const std::vector<double>& direction) {
        std::vector<double> out(direction.size());
        for (std::size_t at = 0; at < out.size(); ++at)
            for (std::size_t k = 0; k < 6; ++k)
                out[at] += metrics[at / 6][at % 6][k] * direction[at - at % 6 + k];
        return out;
    };
    Vec3d middle;
    for (const Camera& c : given_) middle += vec_cast<double>(camera_centre(c));
    middle = middle / double(given_.size());
    // A rotation W, a translation V and a scaling s of the world about `middle` are, in the frame
    // of a camera, a rotation by -R W and a translation by R W x t - R V + s t.
    for (int k = 0; k < 7; ++k) {
        std::vector<double> direction;
        for (std::size_t i = 0; i < given_.size(); ++i) {
            const Rigid3d T{mat_cast<double>(given_[i].camera_from_world.R),
                            vec_cast<double>(given_[i].camera_from_world.t)};
            const Vec3d t = T * middle, e = k < 6 ? column(T.R, k % 3) : Vec3d{};
            const Vec3d turn = k < 3 ? -e : Vec3d{}, shift = k < 3 ? cross(e, t) : k < 6 ? -e : t;
            for (int a = 0; a < 3; ++a) direction.push_back(scale_[i].f * turn[a]);
            for (int a = 0; a < 3; ++a)
                direction.push_back(scale_[i].f / scale_[i].depth * shift[a]);
        }
        const auto length = [&] { return std::sqrt(dot_of(dual(direction), direction.data())); };
        const auto remove_others = [&] {
            for (std::size_t g = 0; g < gauge_.size(); g += 2)
                add_scaled(direction.data(), -dot_of(gauge_[g + 1], direction.data()), gauge_[g]);
        };
        const double whole = length();
        remove_others(), remove_others();  // twice against rounding
        const double rest = length();
        if (!(rest > 1e-6 * whole)) continue;  // the other directions span it already
        for (double& value : direction) value /= rest;
        std::vector<double> of_direction = dual(direction);
        gauge_.push_back(std::move(direction)), gauge_.push_back(std::move(of_direction));
    }
}

void CameraRefinement::place() {
    for (int i = 0; i < views(); ++i) {
        const Camera& from = given_[i];
        const auto [f, depth] = scale_[i];
        const Rigid3d moved =
            rigid_exp(vec_at(motion(i)) / f, (depth / f) * vec_at(motion(i) + 3)) *
            Rigid3d{mat_cast<double>(from.camera_from_world.R),
                    vec_cast<double>(from.camera_from_world.t)};
        cameras_[i].camera_from_world = {mat_cast<float>(moved.R), vec_cast<float>(moved.t)};
    }
}

void CameraRefinement::step(const std::vector<double>& gradients, double rate) {
    const std::size_t n = parameters();
    std::vector<double> by(n, 0);
    for (int i = 0; i < views(); ++i) {
        const double* const g = gradients.data() + kCameraParameters * i;
        if (!std::all_of(g, g + kCameraParameters, [](double v) { return std::isfinite(v); }))
            continue;  // the splats are not finite either, and the training rolls back
        for (std::size_t k = 0; k < 6; ++k)
            by[6 * i + k] = g[k] * (k < 3 ? 1 : scale_[i].depth) / scale_[i].f;
    }
    // The shared drift of splats would push all views along, and Adam would amplify it.
    for (std::size_t g = 0; g < gauge_.size(); g += 2)
        add_scaled(by.data(), -dot_of(gauge_[g], by.data()), gauge_[g + 1]);
    double *const x = numbers_.data(), *const m = x + n, *const v = m + n;
    const double count = ++numbers_[3 * n];
    const double correct1 = 1 - std::pow(kBeta1, count), correct2 = 1 - std::pow(kBeta2, count);
    for (std::size_t k = 0; k < n; ++k) {
        by[k] += double(options_.prior) * x[k];
        m[k] = kBeta1 * m[k] + (1 - kBeta1) * by[k];
        v[k] = kBeta2 * v[k] + (1 - kBeta2) * by[k] * by[k];
        x[k] -= rate * (m[k] / correct1) / (std::sqrt(v[k] / correct2) + kEps);
    }
    for (std::size_t g = 0; g < gauge_.size(); g += 2)
        add_scaled(x, -dot_of(gauge_[g + 1], x), gauge_[g]);
    const double most = double(options_.bound_px);
    for (int i = 0; i < views(); ++i) shorten(motion(i), most), shorten(motion(i) + 3, most);
    place();
}

CameraMove CameraRefinement::move(int view) const {
    const double turn = norm(vec_at(motion(view)));
    return {turn, norm(vec_at(motion(view) + 3)), turn / scale_[view].f * 180 / M_PI};
}

void CameraRefinement::restore(std::vector<double> numbers, std::size_t gradients) {
    const std::size_t expected = kCameraParameters * given_.size();
    if (numbers.size() != numbers_.size() || gradients != expected)
        throw Error(ExitCode::input,
                    "checkpoint arrays 'cameras.numbers' and 'cameras.gradients' have ",
                    numbers.size(), " and ", gradients, " elements, expected ", numbers_.size(),
                    " and ", expected);
    for (const double number : numbers)
        if (!std::isfinite(number))
            throw Error(ExitCode::input, "checkpoint array 'cameras.numbers' is not finite");
    numbers_ = std::move(numbers);
    place();
}

}  // namespace tvsgs
