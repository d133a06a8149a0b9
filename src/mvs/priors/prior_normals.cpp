#include <algorithm>
#include <cmath>

#include "core/device/parallel.h"
#include "core/error.h"
#include "core/math/eigen.h"
#include "core/math/point_tree.h"
#include "mvs/priors/prior_fit.h"

namespace tvsgs {

std::vector<Vec3f> cloud_normals(const std::vector<Vec3f>& points) {
    constexpr std::size_t kNeighbours = 12;
    constexpr double kFlat = 0.1;  // largest ratio of variances, across to along the plane
    std::vector<Vec3f> normals(points.size());
    if (points.size() < kNeighbours) return normals;
    const PointTree<float> tree(points);
    parallel_for(Cpu{}, static_cast<int>(points.size()), [&](int i) {
        std::size_t index[kNeighbours];
        float squared[kNeighbours];
        const auto at = static_cast<std::size_t>(i);
        const std::size_t count = tree.nearest(points[at], kNeighbours, index, squared);
        Vec3d near[kNeighbours];
        for (std::size_t k = 0; k < count; ++k) near[k] = vec_cast<double>(points[index[k]]);
        const SymEigen3<double> eigen = sym_eigen(second_moments({near, count}));
        if (eigen.values.y > 0 && eigen.values.z < kFlat * eigen.values.y)
            normals[at] = vec_cast<float>(column(eigen.vectors, 2));
    });
    return normals;
}

NormalReading reading_of(const NormalConvention& convention) {
    NormalReading reading;
    if (convention.frame == NormalFrame::world) reading.world = true;
    if (convention.frame == NormalFrame::camera_opengl) reading.signs = {1, -1, -1};
    if (convention.facing_away) reading.signs = -reading.signs;
    return reading;
}

std::string text_of(const NormalReading& reading) {
    const Vec3f s = reading.signs;
    if (reading.world) return s.x > 0 ? "world" : "world, facing away";
    if (s.x > 0 && s.y > 0 && s.z > 0) return "camera_opencv";
    if (s.x > 0 && s.y < 0 && s.z < 0) return "camera_opengl";
    if (s.x < 0 && s.y < 0 && s.z < 0) return "camera_opencv, facing away";
    if (s.x < 0 && s.y > 0 && s.z > 0) return "camera_opengl, facing away";
    return str("camera_opencv with", s.x < 0 ? " x" : "", s.y < 0 ? " y" : "", s.z < 0 ? " z" : "",
               " turned");
}

namespace {

constexpr std::size_t kFewest = 50;

double mean_cosine(const std::vector<NormalSample>& samples, const NormalReading& r) {
    double sum = 0;
    for (const NormalSample& s : samples)
        sum += dot(vec_cast<double>(r.signs) * (r.world ? s.found_world : s.found), s.expected);
    return sum / static_cast<double>(samples.size());
}

}  // namespace

PriorAgreement agreement_of(const std::vector<NormalSample>& samples,
                            const NormalReading& reading) {
    if (samples.size() < kFewest) return {};
    Vec3d mean{};
    for (const NormalSample& s : samples) mean += s.expected / static_cast<double>(samples.size());
    return {mean_cosine(samples, reading), norm(mean)};
}

NormalChoice choose_normals(const std::vector<NormalSample>& samples,
                            const NormalConvention& convention) {
    constexpr double kClearly = 0.2, kLeast = 0.3;
    NormalChoice choice{reading_of(convention), 0, samples.size()};
    if (samples.size() < kFewest) return choice;
    const auto cosine = [&](const NormalReading& r) { return mean_cosine(samples, r); };
    NormalReading best;
    double highest = -2;
    const auto consider = [&](const NormalReading& r) {
        if (const double c = cosine(r); c > highest) best = r, highest = c;
    };
    for (int turned = 0; turned < 8; ++turned)
        consider(
            {false, {turned & 1 ? -1.f : 1.f, turned & 2 ? -1.f : 1.f, turned & 4 ? -1.f : 1.f}});
    consider({true, {1, 1, 1}}), consider({true, {-1, -1, -1}});

    const double expected = cosine(choice.reading);
    const auto two_digits = [](double c) { return std::round(100 * c) / 100; };
    if (!(highest > kLeast))
        throw Error(ExitCode::input, "E_PRIORS: normals: no frame agrees with the surface at ",
                    samples.size(), " points (best mean cosine ", two_digits(highest), ", ",
                    text_of(best), "; expected above ", kLeast,
                    "); are they the normals of these photographs?");
    choice.cosine = expected;
    if (highest < expected + kClearly) return choice;
    if (!convention.declared_by.empty())
        throw Error(ExitCode::input, "E_PRIORS: ", convention.declared_by, ": normals in frame ",
                    text_of(choice.reading), " agree with the surface at ", samples.size(),
                    " points with a mean cosine of ", two_digits(expected), ", in frame ",
                    text_of(best), " with ", two_digits(highest),
                    "; declare the latter frame and facing");
    choice.reading = best, choice.cosine = highest;
    return choice;
}

}  // namespace tvsgs
