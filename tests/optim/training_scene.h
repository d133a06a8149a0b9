// A scene whose photographs are renders of splats, so that training can reproduce them exactly.
#pragma once

#include "optim/loop/train.h"
#include "support/random_gaussians.h"

namespace tvsgs::test {

/// Three views of 40 x 30 pixels of 150 splats; the initial points are the displaced centres.
inline Scene rendered_scene() {
    const Gaussians<Cpu> truth = random_gaussians(150, 21, 0.15, 0);
    Scene scene;
    auto backbone = make_backbone<Cpu>("ewa", {});
    for (float angle : {-0.4f, 0.0f, 0.4f}) {
        View view;
        view.camera = test_camera(40, 30, angle);
        const auto& images = backbone->forward(truth, view.camera, 0, Maps::color);
        view.photo = ImageU8(40, 30, 3);
        for (std::size_t p = 0; p < images.color.size(); ++p)
            for (int c = 0; c < 3; ++c)
                view.photo.pixels[3 * p + static_cast<std::size_t>(c)] = static_cast<std::uint8_t>(
                    255 * std::clamp(images.color[p][c], 0.0f, 1.0f) + 0.5f);
        scene.train.push_back(std::move(view));
    }
    Random random(22);
    for (std::size_t i = 0; i < truth.means.size(); ++i)
        scene.points.positions.push_back(truth.means[i] + vec_cast<float>(0.05 * random.normal3()));
    scene.extent = 2;
    return scene;
}

/// Options with all losses, voting, growth and trims within `iterations`.
inline TrainOptions everything_on(int iterations) {
    TrainOptions o;
    o.iterations = iterations;
    o.backbone = "ewa";
    o.loss.flatten.weight = 1;
    o.loss.normal = {0.015f, 5};
    o.loss.multi_view_geometry = {0.03f, 7};
    o.loss.multi_view_ncc = {0.15f, 9};
    o.loss.multi_view.max_distance = 3;
    o.loss.photometric.exposure = true;
    o.loss.photometric.exposure_start = 11;
    o.loss.photometric.dropout = 0.1f;
    o.loss.tv_normal.weight = 0.05f;
    o.loss.tv_position.weight = 0.05f;
    o.tv.k = 20;
    o.tv.refresh_every = 20;
    o.model.sh_every = 10;
    o.model.longest_axis = 3;
    o.densify.from = 10;
    o.densify.every = 10;
    o.densify.trim_every = 20;
    o.densify.opacity_reset_every = 30;
    return o;
}

}  // namespace tvsgs::test
