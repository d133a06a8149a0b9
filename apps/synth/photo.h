// Makes photographs from renders of tvsgs-synth: highlights, background, exposure, noise.
#pragma once

#include "apps/synth/object.h"
#include "mesh/draw/mesh_render.h"

namespace tvsgs::synth {

/// Highlights of a mesh: Blinn-Phong, white, with the light of its shading.
class Highlights {
public:
    Highlights(const Shape& shape, const TriangleMesh& mesh, float strength)
        : mesh_(mesh), normals_(vertex_normals(mesh)), peak_(mesh.vertices.size()) {
        parallel_for(Cpu{}, static_cast<int>(peak_.size()), [&](int i) {
            const Vec3f n = normals_[i];
            if (dot(n, to_light_) > 0)
                peak_[i] =
                    strength * light_reaching(shape, mesh.vertices[i] + 0.01f * n, to_light_);
        });
    }

    /// The mesh with highlights as seen from `eye`; colours may exceed 1.
    TriangleMesh seen_from(Vec3f eye) const {
        constexpr float kExponent = 32;  // half as bright at 12 degrees from the mirror direction
        TriangleMesh mesh = mesh_;
        parallel_for(Cpu{}, static_cast<int>(peak_.size()), [&](int i) {
            const Vec3f half = normalize(normalize(eye - mesh.vertices[i]) + to_light_);
            const float cosine = std::max(0.0f, dot(normals_[i], half));
            const float added = peak_[i] * std::pow(cosine, kExponent);
            mesh.colors[i] += Vec3f{added, added, added};
        });
        return mesh;
    }

private:
    const TriangleMesh& mesh_;
    Vec3f to_light_ = normalize(kLight);
    std::vector<Vec3f> normals_;
    std::vector<float> peak_;
};

/// Fills the background with a textured sky at infinity.
inline void add_sky(MeshRender& render, const Camera& camera, std::uint64_t seed) {
    parallel_for(Cpu{}, camera.width_px * camera.height_px, [&](int i) {
        if (render.face.pixels[i] >= 0) return;
        const int x = i % camera.width_px, y = i / camera.width_px;
        const Vec3f direction =
            normalize(transpose_times(camera.camera_from_world.R, pixel_ray(camera, x, y)));
        const Vec3f color = textured({0.4f, 0.5f, 0.6f}, direction, seed);
        for (int c = 0; c < 3; ++c) render.color.at(x, y, c) = color[c];
    });
}

/// Fills the background with white far above the range of a photograph.
inline void add_white(MeshRender& render) {
    for (std::size_t i = 0; i < render.face.pixels.size(); ++i)
        for (std::size_t c = 0; c < 3 && render.face.pixels[i] < 0; ++c)
            render.color.pixels[3 * i + c] = 1.5f;
}

/// Fills the background with patches of `side` pixels of random grey, different in each view, so
/// that nothing matches.
inline void add_clutter(MeshRender& render, int side, std::uint64_t seed, int view) {
    const int width = render.color.width;
    parallel_for(Cpu{}, width * render.color.height, [&](int i) {
        if (render.face.pixels[i] >= 0) return;
        const auto patch = static_cast<std::uint64_t>(i / width / side) << 16 |
                           static_cast<std::uint64_t>(i % width / side);
        const Random4 r =
            random4(seed, RandomStream::test, patch, static_cast<std::uint32_t>(view));
        for (int c = 0; c < 3; ++c)
            render.color.pixels[3 * static_cast<std::size_t>(i) + c] = uniform(r.v[0]);
    });
}

/// Relative exposure of a view, within 1 +- drift. Steps by the golden ratio, so that consecutive
/// views differ.
inline double exposure_gain(double drift, int view) {
    const double turn = 0.6180339887498949 * view;
    return 1 + drift * (2 * (turn - std::floor(turn)) - 1);
}

inline void add_noise(ImageF& image, float sigma, std::uint64_t seed, int view) {
    if (sigma <= 0) return;
    parallel_for(Cpu{}, image.width * image.height, [&](int i) {
        const auto index = static_cast<std::uint64_t>(view) << 32 | static_cast<std::uint64_t>(i);
        const Vec3f n = normal3(random4(seed, RandomStream::test, index));
        for (int c = 0; c < 3; ++c)
            image.pixels[3 * static_cast<std::size_t>(i) + c] += sigma / 255 * n[c];
    });
}

}  // namespace tvsgs::synth
