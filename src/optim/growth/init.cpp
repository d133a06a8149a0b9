#include "optim/growth/init.h"

#include <limits>

#include "core/device/parallel.h"
#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"
#include "core/math/point_forest.h"
#include "core/math/quantile.h"
#include "core/math/rng.h"
#include "render/tiles/sh_math.h"

namespace tvsgs {
namespace {

/// The shortest rotation from the z axis to a unit vector.
Quatf rotation_to(Vec3f n) {
    if (!(n.z > -0.9999f)) return {0, 1, 0, 0};  // half a turn about x
    return normalize(Quatf{1 + n.z, -n.y, n.x, 0});
}

constexpr float kThickness = 0.1f;  // ratio of a disc's thickness to its radius

/// Draws a uniform rotation: a normal deviate in four dimensions has no preferred direction.
Quatf random_rotation(std::uint64_t index) {
    const Vec3f xyz = normal3(random4(0, RandomStream::init, index, 0)),
                w = normal3(random4(0, RandomStream::init, index, 1));
    return normalize(Quatf{w.x, xyz.x, xyz.y, xyz.z});
}

/// The largest standard deviation, world units, of at most `share` of the larger side of each
/// photograph that shows the point or has it less than half a photograph outside.
float largest_scale(const std::vector<View>& views, Vec3f point, float share) {
    float largest = std::numeric_limits<float>::infinity();
    for (const View& view : views) {
        const Camera& c = view.camera;
        const Vec3f p = c.camera_from_world * point;
        const float width = float(c.width_px), height = float(c.height_px);
        const float x = c.fx_px * p.x + p.z * (c.cx_px - 0.5f * width),
                    y = c.fy_px * p.y + p.z * (c.cy_px - 0.5f * height);
        if (std::abs(x) < p.z * width && std::abs(y) < p.z * height)
            largest = std::min(largest, share * p.z * std::max(width / c.fx_px, height / c.fy_px));
    }
    return largest;
}

/// Tells quickly whether largest_scale() may be less than a scale: only near cameras limit it.
class NearCameras {
public:
    NearCameras(const std::vector<View>& views, float share)
        : centres_(centres_of(views)), tree_(centres_) {
        float least = std::numeric_limits<float>::infinity(), most = 1;
        for (const View& view : views) {
            const Camera& c = view.camera;
            const float width = float(c.width_px), height = float(c.height_px),
                        x = (width + std::abs(c.cx_px - 0.5f * width)) / c.fx_px,
                        y = (height + std::abs(c.cy_px - 0.5f * height)) / c.fy_px;
            least = std::min(least, share * std::max(width / c.fx_px, height / c.fy_px));
            most = std::max(most, std::sqrt(1 + x * x + y * y));  // of distance over depth
        }
        per_scale_ = 1.001f * most / least;
        for (const Vec3f centre : centres_) size_ = std::max(size_, norm(centre));
    }

    bool may_limit(Vec3f point, float scale) const {
        const float reach = per_scale_ * scale + 1e-4f * (size_ + norm(point));
        std::size_t index = 0;
        float squared = 0;
        return !std::isfinite(reach) ||
               tree_.nearest_within(point, reach * reach, &index, &squared);
    }

private:
    static std::vector<Vec3f> centres_of(const std::vector<View>& views) {
        std::vector<Vec3f> centres;
        for (const View& view : views) centres.push_back(camera_centre(view.camera));
        return centres;
    }

    std::vector<Vec3f> centres_;
    PointTree<float> tree_;
    float per_scale_ = 0, size_ = 0;  // size_: of the coordinates, bounds rounding
};

}  // namespace

std::vector<float> mean_squared_neighbour_distance(const std::vector<Vec3f>& points, int k) {
    std::vector<float> result(points.size(), 0);
    if (points.size() < 2) return result;
    const std::size_t wanted = std::min(points.size(), std::size_t(k) + 1);
    const auto average = [&](std::size_t i, const float* squared, std::size_t found) {
        // The first result is the point itself, or a duplicate at distance 0: skip one zero.
        double sum = 0;
        for (std::size_t j = 1; j < found; ++j) sum += double(squared[j]);
        if (found > 1) result[i] = float(sum / double(found - 1));
    };
    PointForest(points).for_each(wanted, average);
    return result;
}

float median_depth(const Scene& scene) {
    // A few thousand points give the median to one or two percent.
    const std::size_t stride = 1 + scene.points.positions.size() / 5000;
    std::vector<float> depths;
    for (const View& view : scene.train)
        for (std::size_t i = 0; i < scene.points.positions.size(); i += stride) {
            const float z = (view.camera.camera_from_world * scene.points.positions[i]).z;
            if (z > 0) depths.push_back(z);
        }
    return depths.empty() ? 0 : middle_of(depths);
}

float guard_unit(const Scene& scene) {
    const float depth = median_depth(scene);
    return depth > 0 ? std::min(depth, 1.0f) : 1;
}

Gaussians<Cpu> init_gaussians(const Scene& scene, const InitOptions& options, int sh_degree) {
    std::vector<Vec3f> positions, colors, normals;
    std::vector<float> confidences;
    const bool support = options.support && !scene.points.confidences.empty();
    const bool use_normals = options.use_normals && !scene.points.normals.empty();
    const float unit = guard_unit(scene), at_camera_distance = 1e-2f * unit;
    for (std::size_t i = 0; i < scene.points.positions.size(); ++i) {
        const Vec3f p = scene.points.positions[i];
        const bool at_camera = std::ranges::any_of(scene.train, [&](const View& view) {
            return norm(p - camera_centre(view.camera)) < at_camera_distance;
        });
        if (at_camera) continue;
        positions.push_back(p);
        colors.push_back(scene.points.colors.empty() ? Vec3f{0.5f, 0.5f, 0.5f}
                                                     : scene.points.colors[i]);
        if (use_normals) normals.push_back(scene.points.normals[i]);
        if (support) confidences.push_back(scene.points.confidences[i]);
    }
    if (const std::size_t dropped = scene.points.positions.size() - positions.size(); dropped > 0)
        spdlog::warn("Dropped {} start points within {:g} world units of a camera",
                     grouped(dropped), at_camera_distance);
    if (positions.empty())
        throw Error(ExitCode::input, "E_NO_POINTS: ", scene.path,
                    ": no start points are left; give a cloud with --init-ply");

    const std::vector<float> squared = mean_squared_neighbour_distance(positions, 3);
    Gaussians<Cpu> g;
    resize(g, int(positions.size()), sh_degree);
    fill_zero(g);
    if (support) g.uncertainty.resize(positions.size());
    const float logit = std::log(options.opacity / (1 - options.opacity));
    const NearCameras near(scene.train, options.max_extent);
    parallel_for(Cpu{}, g.size(), [&](int i) {
        g.means[i] = positions[i];
        float scale = std::sqrt(squared[i]);
        if (support) g.uncertainty[i] = confidences[i] > 0 ? scale : 0;
        if (options.max_extent > 0 && near.may_limit(positions[i], scale))
            scale = std::min(scale, largest_scale(scene.train, positions[i], options.max_extent));
        const float log_scale = std::log(std::max(scale, std::sqrt(1e-7f) * unit));
        g.log_scales[i] = {log_scale, log_scale, log_scale};
        g.quats[i] = options.random_rotations ? random_rotation(i) : Quatf{1, 0, 0, 0};
        if (use_normals && std::abs(norm(normals[i]) - 1) < 0.1f) {  // skips zero normals
            g.quats[i] = rotation_to(normalize(normals[i]));
            g.log_scales[i].z += std::log(kThickness);
        }
        g.opacity_logits[i] = logit;
        g.sh[i] = (colors[i] - Vec3f{0.5f, 0.5f, 0.5f}) / float(kShC0);
    });
    return g;
}

}  // namespace tvsgs
