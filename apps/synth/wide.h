// The wide scene of tvsgs-synth, for tests of blocks: many objects on uneven ground, as seen by a
// survey flight.
#pragma once

#include "apps/synth/object.h"
#include "apps/synth/views.h"

namespace tvsgs::synth {

// Of its meshes: a pixel of an image of 160 pixels on the lower flight.
constexpr float kWideSpacing = 0.03f;

/// A pole, and a house with a gable roof: thin parts and corners, unlike the round shapes.
inline Shape pole() {
    const auto distance = [](Vec3f p) {
        const float post = capsule(p, {0, 0, -0.2f}, {0, 0, 1.9f}, 0.09f);
        return std::max(std::min(post, sphere(p, {0, 0, 1.95f}, 0.22f)), -0.06f - p.z);
    };
    const auto base_color = [](Vec3f p) {
        return std::sin(12 * p.z) > 0 ? Vec3f{0.8f, 0.75f, 0.7f} : Vec3f{0.7f, 0.25f, 0.2f};
    };
    return {distance, base_color, {-0.35f, -0.35f, -0.15f}, {0.35f, 0.35f, 2.3f}};
}
inline Shape house() {
    const auto distance = [](Vec3f p) {
        const float roof = 0.70711f * (std::abs(p.y) + p.z - 1.75f);
        return std::max({std::abs(p.x) - 0.9f, std::abs(p.y) - 0.7f, roof, -0.06f - p.z});
    };
    const auto base_color = [](Vec3f p) {
        if (std::abs(p.y) + p.z > 1.7f) return Vec3f{0.62f, 0.3f, 0.22f};
        const bool window = std::sin(9 * p.x) * std::sin(9 * p.y) > 0.3f && p.z > 0.4f;
        return window ? Vec3f{0.25f, 0.3f, 0.4f} : Vec3f{0.75f, 0.7f, 0.6f};
    };
    return {distance, base_color, {-1, -0.8f, -0.15f}, {1, 0.8f, 1.85f}};
}

/// Objects in rows on a square of `side` units around the origin, one per 2.4 x 2.4 units, an odd
/// number per row, so that some stand on its middle lines.
class WideScene {
public:
    WideScene(float side, std::uint64_t seed)
        : side_(side), seed_(seed), kinds_{bust(), house(), spheres(), pole(), torus()} {
        const int row = std::max(3, static_cast<int>(std::lround((side / 2.4f - 1) / 2)) * 2 + 1);
        const float pitch = side / static_cast<float>(row);
        for (int i = 0; i < row * row; ++i) {
            const Random4 r =
                random4(seed, RandomStream::sampling, static_cast<std::uint64_t>(i), 7);
            Object object;
            // Knight's moves: no row or column has only one kind.
            object.kind = static_cast<std::size_t>((i % row + 2 * (i / row)) % 5);
            object.scale = (0.75f + 0.35f * uniform(r.v[0])) * std::min(1.0f, pitch / 2.4f) * 0.75f;
            const auto place = [&](int at, std::uint32_t draw) {
                return (static_cast<float>(at) + 0.5f + 0.3f * (uniform(draw) - 0.5f)) * pitch -
                       0.5f * side;
            };
            object.base = {place(i % row, r.v[1]), place(i / row, r.v[2]), 0};
            object.turn = 6.2831853f * uniform(r.v[3]);
            object.base.z = relief(object.base.x, object.base.y);
            objects_.push_back(object);
        }
    }

    /// Of the ground; flat around each object.
    float height(float x, float y) const {
        float z = relief(x, y);
        for (const Object& object : objects_) {
            const float d = std::hypot(x - object.base.x, y - object.base.y) / object.scale;
            const float t = std::clamp((1.7f - d) / 0.6f, 0.0f, 1.0f);
            z += t * t * (3 - 2 * t) * (object.base.z - z);
        }
        return z;
    }

    float side() const { return side_; }

    /// Bounds of the scene.
    Vec3f low() const { return {-0.5f * side_, -0.5f * side_, -0.6f}; }
    Vec3f high() const { return {0.5f * side_, 0.5f * side_, 2.6f}; }

    /// Ground and objects, coloured like make_scene_mesh() with its `texture`; parts of the ground
    /// have no texture.
    TriangleMesh mesh(float texture) const {
        TriangleMesh mesh = ground();
        std::vector<int> owner(mesh.vertices.size(), -1);
        for (std::size_t k = 0; k < objects_.size(); ++k) {
            append(surface_nets(placed(objects_[k]), kWideSpacing), mesh);
            owner.resize(mesh.vertices.size(), static_cast<int>(k));
        }
        color(owner, texture, mesh);
        return mesh;
    }

private:
    struct Object {
        std::size_t kind = 0;
        float scale = 1, turn = 0;
        Vec3f base;

        Vec3f local(Vec3f p) const {
            const Vec3f q = (p - base) / scale;
            const float c = std::cos(turn), s = std::sin(turn);
            return {c * q.x + s * q.y, c * q.y - s * q.x, q.z};
        }
    };
    static constexpr float kReach = 1.45f;  // of an unscaled object from its axis
    static constexpr float kTop = 2.3f;

    float relief(float x, float y) const {
        return 0.35f * noise({0.25f * x, 0.25f * y, 0.5f}, seed_, 11).x +
               0.06f * noise({1.1f * x, 1.1f * y, 0.5f}, seed_, 12).x;
    }

    Shape placed(const Object& object) const {
        const Shape& kind = kinds_[object.kind];
        Shape shape;
        shape.distance = [&kind, object](Vec3f p) {
            return object.scale * kind.distance(object.local(p));
        };
        const float reach = kReach * object.scale;
        shape.low = object.base + Vec3f{-reach, -reach, object.scale * kind.low.z};
        shape.high = object.base + Vec3f{reach, reach, object.scale * kind.high.z};
        return shape;
    }

    /// Distance to the nearest object, or a lower bound if it is far.
    float distance(Vec3f p) const {
        float nearest = 1e3f;
        for (const Object& object : objects_) {
            const Vec3f q = p - object.base;
            const float to_box =
                std::max({std::hypot(q.x, q.y) - kReach * object.scale, q.z - kTop * object.scale});
            const bool far = to_box > 0.25f;
            nearest = std::min(
                nearest,
                far ? to_box : object.scale * kinds_[object.kind].distance(object.local(p)));
        }
        return nearest;
    }

    TriangleMesh ground() const {
        TriangleMesh mesh;
        const int cells = static_cast<int>(std::ceil(side_ / kWideSpacing));
        const float step = side_ / static_cast<float>(cells);
        mesh.vertices.resize(static_cast<std::size_t>(cells + 1) * (cells + 1));
        parallel_for(Cpu{}, static_cast<int>(mesh.vertices.size()), [&](int i) {
            const float x = static_cast<float>(i % (cells + 1)) * step - 0.5f * side_;
            const float y = static_cast<float>(i / (cells + 1)) * step - 0.5f * side_;
            mesh.vertices[i] = {x, y, height(x, y)};
        });
        for (int y = 0; y < cells; ++y)
            for (int x = 0; x < cells; ++x) {
                const int a = y * (cells + 1) + x, b = a + cells + 1;
                mesh.faces.push_back({a, a + 1, b + 1});
                mesh.faces.push_back({a, b + 1, b});
            }
        return mesh;
    }

    void color(const std::vector<int>& owner, float texture, TriangleMesh& mesh) const {
        Shape all;
        all.distance = [this](Vec3f p) { return distance(p); };
        const std::vector<Vec3f> normals = vertex_normals(mesh);
        mesh.colors.resize(mesh.vertices.size());
        parallel_for(Cpu{}, static_cast<int>(mesh.vertices.size()), [&](int i) {
            const Vec3f p = mesh.vertices[i], normal = normals[i];
            Vec3f base;
            float contrast = texture;
            if (owner[i] < 0) {
                const Vec3f patch = noise({0.6f * p.x, 0.6f * p.y, 0.5f}, seed_, 13);
                base = Vec3f{0.48f, 0.5f, 0.42f} + 0.12f * patch;
                contrast *= std::clamp(0.6f + 1.5f * patch.y, 0.1f, 1.0f);
            } else {
                const Object& object = objects_[owner[i]];
                base = kinds_[object.kind].base_color(object.local(p));
            }
            mesh.colors[i] = lit(all, p, normal, 0.02f, height(p.x, p.y), base, contrast, seed_);
        });
    }

    float side_;
    std::uint64_t seed_;
    std::array<Shape, 5> kinds_;
    std::vector<Object> objects_;
};

/// Cameras alternating between two heights, each looking obliquely at its own target on the ground;
/// targets are spread evenly for any number of views.
inline std::vector<SynthView> make_wide_views(const SynthOptions& options, const WideScene& scene) {
    const auto halton = [](int i, int base) {
        double value = 0, digit = 1;
        for (int k = i + 1; k > 0; k /= base) value += (digit /= base) * (k % base);
        return value;
    };
    std::vector<SynthView> views;
    for (int i = 0; i < options.views; ++i) {
        const bool high = i % 2 == 1;
        const double spread = 0.86 * static_cast<double>(scene.side());
        Vec3d target{(halton(i, 2) - 0.5) * spread, (halton(i, 3) - 0.5) * spread, 0};
        target.z = 0.3 + static_cast<double>(scene.height(static_cast<float>(target.x),
                                                          static_cast<float>(target.y)));
        views.push_back(make_view(options, i, target, high ? 6.5 : 4.5, 2.399963 * i,
                                  (high ? 60 : 48) * kDegree));
        views.back().azimuth_rad = std::hypot(target.x, target.y);  // `train_3`: around the middle
    }
    return views;
}

}  // namespace tvsgs::synth
