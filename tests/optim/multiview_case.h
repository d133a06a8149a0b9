// Inputs of the multi-view losses on the host, and their evaluation on either device. The images of
// both views are made up: a test backbone returns them instead of rendering.
#pragma once

#include "optim/losses/losses_list.h"
#include "render/backbone.h"
#include "support/random_gaussians.h"

namespace tvsgs::test {

struct MapsD {
    std::vector<Vec3d> normal;
    std::vector<double> depth;
};

/// One view: its maps and its grey photograph.
struct ViewMaps {
    Camera camera;
    std::vector<Vec3f> normal;
    std::vector<float> depth;
    int grey_width = 0, grey_height = 0;
    std::vector<std::uint8_t> grey;
};

inline constexpr int kPlaneWidth = 40, kPlaneHeight = 30;

/// Maps of the plane n . X = 0.1, with n towards the cameras, some noise, and varying coverage. The
/// grey photograph shows a texture on the plane at `fineness` times the resolution.
inline ViewMaps plane_view(float angle, unsigned seed, double noise, int fineness) {
    Random random(seed);
    ViewMaps v;
    Camera& c = v.camera;
    c = test_camera(kPlaneWidth, kPlaneHeight, angle);
    const Vec3d n = normalize(Vec3d{0.3, -0.2, -1});
    const auto R = mat_cast<double>(c.camera_from_world.R);
    const Vec3d n_camera = R * n,
                centre = -transpose_times(R, vec_cast<double>(c.camera_from_world.t));
    const double distance = dot(n, centre) - 0.1;
    const auto ray = [&](double x, double y) {
        return Vec3d{(x - c.cx_px) / c.fx_px, (y - c.cy_px) / c.fy_px, 1};
    };
    for (int y = 0; y < kPlaneHeight; ++y)
        for (int x = 0; x < kPlaneWidth; ++x) {
            const double coverage = random.uniform(0.6, 1);
            v.normal.push_back(
                vec_cast<float>(coverage * normalize(n_camera + noise * random.normal3())));
            // Noise of the depth: the plane passes through a point near the true one.
            const double depth = -distance / dot(n_camera, ray(x + 0.5, y + 0.5)) *
                                 (1 + 0.1 * noise * random.normal());
            v.depth.push_back(static_cast<float>(depth));
        }
    v.depth[11 * kPlaneWidth + 13] = 0;  // a hole
    v.grey_width = fineness * kPlaneWidth, v.grey_height = fineness * kPlaneHeight;
    for (int y = 0; y < v.grey_height; ++y)
        for (int x = 0; x < v.grey_width; ++x) {
            const Vec3d r = ray((x + 0.5) / fineness, (y + 0.5) / fineness);
            const Vec3d p = centre + -distance / dot(n_camera, r) * transpose_times(R, r);
            v.grey.push_back(static_cast<std::uint8_t>(128 + 60 * std::sin(9 * p.x + 2 * p.y) +
                                                       50 * std::sin(11 * p.y - 3 * p.x)));
        }
    return v;
}

struct MultiViewCase {
    ViewMaps reference, other;
    int samples = 102400;
    PixelCenter pixel_center = PixelCenter::exact;
};

struct MultiViewResult {
    double value = 0, valid = 0;
    std::vector<float> weight;
    std::vector<Vec3f> dL_dnormal;
    std::vector<float> dL_ddepth, dL_dother_depth;  // may be empty
};

template <class Device>
RenderedImages<Device> upload_maps(const ViewMaps& v) {
    RenderedImages<Device> images;
    images.width = v.camera.width_px, images.height = v.camera.height_px;
    images.camera = v.camera;
    copy(v.normal, images.normal);
    copy(v.depth, images.depth);
    return images;
}

template <class Device>
class PreparedImages final : public Backbone<Device> {
public:
    explicit PreparedImages(const ViewMaps& v) : images_(upload_maps<Device>(v)) {}
    const RenderedImages<Device>& forward(const Gaussians<Device>&,
                                          const Camera&,
                                          int,
                                          Maps) override {
        return images_;
    }
    void backward(const Gaussians<Device>&,
                  const ImageGradients<Device>&,
                  Gaussians<Device>&) override {}
    const ScreenStatistics<Device>& statistics() const override { return statistics_; }

private:
    RenderedImages<Device> images_;
    ScreenStatistics<Device> statistics_;
};

template <class Device>
DeviceView<Device> upload_view(const ViewMaps& v, int index) {
    DeviceView<Device> view;
    view.index = index;
    view.camera = v.camera;
    view.grey_width = v.grey_width, view.grey_height = v.grey_height;
    copy(v.grey, view.grey);
    return view;
}

/// Result of adding the geometric (or else the photometric) term `terms` times to an objective that
/// is not empty.
template <class Device>
MultiViewResult evaluate(const MultiViewCase& c, bool geometry, float weight, int terms = 1) {
    const ScheduledOptions options{weight, 1};
    LossContext context{.seed = 5, .pixel_center = c.pixel_center};
    context.shared.multi_view.samples = c.samples;
    std::unique_ptr<Loss<Device>> loss;
    if (geometry)
        loss = std::make_unique<MultiViewGeometryLoss<Device>>(options);
    else
        loss = std::make_unique<MultiViewNccLoss<Device>>(options, context);

    Gaussians<Device> gaussians;
    resize(gaussians, 1, 0);
    std::vector<DeviceView<Device>> views;
    views.push_back(upload_view<Device>(c.reference, 0));
    views.push_back(upload_view<Device>(c.other, 1));
    std::vector<std::unique_ptr<Backbone<Device>>> backbones;
    backbones.push_back(std::make_unique<PreparedImages<Device>>(c.other));
    NeighbourViews<Device> others({{{1}, {0}}, 0.1f}, std::move(backbones), 5);
    const RenderedImages<Device> images = upload_maps<Device>(c.reference);
    others.begin(1, 0, views, gaussians);
    others.compare(images);
    const NeighbourView<Device>& other = others[0];

    Objective<Device> objective;
    objective.dL_dimages.normal.resize(c.reference.normal.size());
    objective.dL_dimages.normal.fill_zero();
    objective.dL_dimages.depth.resize(c.reference.normal.size());
    objective.dL_dimages.depth.fill_zero();
    objective.partial.resize(kSumBlocks);
    objective.count.resize(1);
    copy(std::vector<double>{2}, objective.values);  // a term adds, it never overwrites
    const TensorField<Device> field;
    for (int i = 0; i < terms; ++i)
        loss->add_to(objective, {gaussians, images, views[0], field, {}, 1, &others});

    MultiViewResult result;
    result.value = to_host(objective.values)[0] - 2;
    for (int v : to_host(other.valid())) result.valid += v;
    result.weight.resize(c.reference.normal.size());
    detail::copy(Device{}, other.weight().data, Cpu{}, result.weight.data(),
                 result.weight.size() * sizeof(float));
    result.dL_dnormal = to_host(objective.dL_dimages.normal);
    result.dL_ddepth = to_host(objective.dL_dimages.depth);
    result.dL_dother_depth = to_host(other.dL_dimages().depth);
    return result;
}

/// evaluate<Cuda>, compiled by nvcc.
MultiViewResult evaluate_cuda(const MultiViewCase& c, bool geometry, float weight);

/// A photometric term with exposure, evaluated `steps` times with the same render.
struct ExposureCase {
    int width = 16, height = 12;
    std::vector<Vec3f> color;
    std::vector<std::uint8_t> photo;
    int views = 2, index = 1;
    float ssim = 0.2f;
};
struct ExposureResult {
    double first_value = 0, last_value = 0;
    std::vector<ExposureState> states;
    std::vector<Vec3f> dL_dcolor;  // of the last step
};

template <class Device>
ExposureResult evaluate_exposure(const ExposureCase& c, int steps) {
    PhotometricOptions options;
    options.ssim = c.ssim;
    options.exposure = true;
    options.exposure_start = 1;
    PhotometricLoss<Device> loss(options, {.views = c.views});
    Gaussians<Device> gaussians;
    RenderedImages<Device> images;
    images.width = c.width, images.height = c.height;
    copy(c.color, images.color);
    DeviceView<Device> view;
    view.index = c.index;
    copy(c.photo, view.photo);
    const TensorField<Device> field;
    Objective<Device> objective;
    objective.dL_dimages.color.resize(c.color.size());
    objective.partial.resize(kSumBlocks);
    ExposureResult result;
    for (int step = 1; step <= steps; ++step) {
        objective.dL_dimages.color.fill_zero();
        copy(std::vector<double>{0}, objective.values);
        loss.add_to(objective, {gaussians, images, view, field, {}, step});
        result.last_value = to_host(objective.values)[0];
        if (step == 1) result.first_value = result.last_value;
    }
    result.states = to_host(loss.exposure().states());
    result.dL_dcolor = to_host(objective.dL_dimages.color);
    return result;
}

ExposureResult evaluate_exposure_cuda(const ExposureCase& c, int steps);

}  // namespace tvsgs::test
