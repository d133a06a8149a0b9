// The synthetic objects of tvsgs-synth: implicit shapes, procedural texture, baked light, and their
// meshes.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <string>
#include <unordered_map>
#include <vector>

#include "core/device/parallel.h"
#include "core/math/rng.h"
#include "core/scene/mesh.h"

namespace tvsgs::synth {

/// An object that stands on the plane z = 0, with z up and its front towards +x.
struct Shape {
    std::function<float(Vec3f)> distance;    // signed, negative inside; about 1-Lipschitz
    std::function<Vec3f(Vec3f)> base_color;  // of a point on the surface, [0, 1]
    Vec3f low, high;                         // encloses the surface
};

inline float smooth_min(float a, float b, float radius) {
    const float h = std::max(radius - std::abs(a - b), 0.0f) / radius;
    return std::min(a, b) - 0.25f * h * h * radius;
}
inline float sphere(Vec3f p, Vec3f centre, float radius) {
    return norm(p - centre) - radius;
}
inline float ellipsoid(Vec3f p, Vec3f centre, Vec3f radii) {
    const Vec3f q = p - centre;
    const float k0 = norm(Vec3f{q.x / radii.x, q.y / radii.y, q.z / radii.z});
    const float k1 = norm(
        Vec3f{q.x / (radii.x * radii.x), q.y / (radii.y * radii.y), q.z / (radii.z * radii.z)});
    return k1 > 0 ? k0 * (k0 - 1) / k1 : -std::min({radii.x, radii.y, radii.z});
}
inline float capsule(Vec3f p, Vec3f a, Vec3f b, float radius) {
    const float t = std::clamp(dot(p - a, b - a) / dot(b - a, b - a), 0.0f, 1.0f);
    return norm(p - (a + t * (b - a))) - radius;
}

inline float bust_hair(Vec3f p) {
    const float cap = ellipsoid(p, {-0.09f, 0, 1.52f}, {0.43f, 0.42f, 0.46f});
    return smooth_min(cap, sphere(p, {-0.46f, 0, 1.78f}, 0.19f), 0.08f);
}
inline float bust_body(Vec3f p) {
    const Vec3f q{p.x, std::abs(p.y), p.z};  // symmetric
    const float torso = ellipsoid(p, {-0.02f, 0, 0.22f}, {0.44f, 0.82f, 0.46f});
    return smooth_min(torso, capsule(q, {-0.02f, 0, 0.86f}, {-0.02f, 0.5f, 0.5f}, 0.16f), 0.25f);
}
inline float bust_face(Vec3f p) {
    const Vec3f q{p.x, std::abs(p.y), p.z};
    float d = ellipsoid(p, {0.03f, 0, 1.44f}, {0.4f, 0.35f, 0.46f});
    d = smooth_min(d, sphere(p, {0.2f, 0, 1.16f}, 0.18f), 0.2f);                     // chin
    d = smooth_min(d, capsule(p, {-0.04f, 0, 0.6f}, {0, 0, 1.2f}, 0.19f), 0.15f);    // neck
    d = -smooth_min(-d, sphere(q, {0.45f, 0.15f, 1.49f}, 0.09f), 0.1f);              // eye sockets
    d = smooth_min(d, sphere(q, {0.36f, 0.15f, 1.48f}, 0.055f), 0.03f);              // eyes
    d = smooth_min(d, capsule(p, {0.4f, 0, 1.5f}, {0.5f, 0, 1.36f}, 0.05f), 0.08f);  // nose
    d = smooth_min(d, capsule(q, {0.41f, 0, 1.2f}, {0.37f, 0.09f, 1.22f}, 0.025f), 0.05f);  // mouth
    return smooth_min(d, ellipsoid(q, {0.02f, 0.37f, 1.42f}, {0.09f, 0.06f, 0.13f}),
                      0.05f);  // ears
}

inline Shape bust() {
    const auto distance = [](Vec3f p) {
        const float head = smooth_min(bust_face(p), bust_hair(p), 0.04f);
        return std::max(smooth_min(head, bust_body(p), 0.06f),
                        -0.02f - p.z);  // cut off slightly below the ground
    };
    const auto base_color = [](Vec3f p) {
        const float face = bust_face(p), hair = bust_hair(p), body = bust_body(p);
        if (body < face && body < hair) return Vec3f{0.25f, 0.45f, 0.72f};
        return face < hair ? Vec3f{0.85f, 0.62f, 0.47f} : Vec3f{0.55f, 0.3f, 0.16f};
    };
    return {distance, base_color, {-0.75f, -0.95f, -0.05f}, {0.65f, 0.95f, 2.1f}};
}

inline Shape spheres() {
    struct Ball {
        Vec3f centre;
        float radius;
        Vec3f color;
    };
    static constexpr std::array<Ball, 5> kBalls{
        {{{-0.15f, 0.1f, 0.62f}, 0.62f, {0.8f, 0.42f, 0.3f}},
         {{0.45f, -0.6f, 0.36f}, 0.36f, {0.35f, 0.55f, 0.75f}},
         {{0.62f, 0.42f, 0.27f}, 0.27f, {0.82f, 0.72f, 0.3f}},
         {{-0.1f, 0.05f, 1.48f}, 0.3f, {0.45f, 0.65f, 0.35f}},
         {{-0.6f, -0.62f, 0.2f}, 0.2f, {0.65f, 0.4f, 0.65f}}}};
    const auto distance = [](Vec3f p) {
        float d = 1e30f;
        for (const Ball& ball : kBalls) d = std::min(d, sphere(p, ball.centre, ball.radius));
        return d;
    };
    const auto base_color = [](Vec3f p) {
        return std::min_element(kBalls.begin(), kBalls.end(),
                                [&](const Ball& a, const Ball& b) {
                                    return sphere(p, a.centre, a.radius) <
                                           sphere(p, b.centre, b.radius);
                                })
            ->color;
    };
    return {distance, base_color, {-0.95f, -1.1f, -0.1f}, {1.0f, 0.85f, 1.9f}};
}

inline Shape torus() {
    const auto distance = [](Vec3f p) {  // it stands upright, slightly below the ground
        const Vec2f ring{std::sqrt(p.y * p.y + (p.z - 0.9f) * (p.z - 0.9f)) - 0.65f, p.x};
        return std::max(std::sqrt(dot(ring, ring)) - 0.27f, -0.03f - p.z);
    };
    const auto base_color = [](Vec3f p) {
        const float turn = std::atan2(p.z - 0.9f, p.y);
        return std::sin(6 * turn) > 0 ? Vec3f{0.8f, 0.5f, 0.3f} : Vec3f{0.4f, 0.55f, 0.65f};
    };
    return {distance, base_color, {-0.35f, -1, -0.1f}, {0.35f, 1, 1.9f}};
}

inline Shape make_shape(const std::string& name) {
    return name == "bust" ? bust() : name == "spheres" ? spheres() : torus();
}

inline Vec3f gradient(const Shape& shape, Vec3f p) {
    constexpr float h = 1e-3f;  // float rounding and curvature both stay below 1 % of the slope
    const auto d = [&](float x, float y, float z) { return shape.distance(p + Vec3f{x, y, z}); };
    return (0.5f / h) *
           Vec3f{d(h, 0, 0) - d(-h, 0, 0), d(0, h, 0) - d(0, -h, 0), d(0, 0, h) - d(0, 0, -h)};
}

/// The zero surface as a closed mesh, by naive surface nets: one vertex in each crossed grid cell,
/// moved onto the surface; one quad across each crossed grid edge.
inline TriangleMesh surface_nets(const Shape& shape, float spacing) {
    constexpr int kBlock = 8;
    int size[3];  // grid points, a whole number of blocks plus one
    for (int c = 0; c < 3; ++c)
        size[c] = kBlock * static_cast<int>(
                               std::ceil((shape.high[c] - shape.low[c]) / (spacing * kBlock))) +
                  1;
    const auto point = [&](int x, int y, int z) {
        return shape.low +
               spacing * Vec3f{static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)};
    };
    const auto index = [&](int x, int y, int z) {
        return (static_cast<std::size_t>(z) * size[1] + y) * size[0] + x;
    };

    // Signs: exact near the surface, one per block that the surface cannot reach.
    std::vector<std::uint8_t> inside(index(size[0] - 1, size[1] - 1, size[2] - 1) + 1);
    const int blocks[3] = {size[0] / kBlock + 1, size[1] / kBlock + 1, size[2] / kBlock + 1};
    parallel_for_heavy(Cpu{}, blocks[0] * blocks[1] * blocks[2], [&](int block) {
        const int x0 = block % blocks[0] * kBlock, y0 = block / blocks[0] % blocks[1] * kBlock,
                  z0 = block / (blocks[0] * blocks[1]) * kBlock;
        const float middle =
            shape.distance(point(x0, y0, z0) + 0.5f * kBlock * spacing * Vec3f{1, 1, 1});
        // Half a diagonal, with a margin of 70 %.
        const bool far = std::abs(middle) > 1.5f * kBlock * spacing;
        for (int z = z0; z < std::min(z0 + kBlock, size[2]); ++z)
            for (int y = y0; y < std::min(y0 + kBlock, size[1]); ++y)
                for (int x = x0; x < std::min(x0 + kBlock, size[0]); ++x)
                    inside[index(x, y, z)] = (far ? middle : shape.distance(point(x, y, z))) < 0;
    });

    TriangleMesh mesh;
    std::unordered_map<std::size_t, int> vertex_of_cell;
    const auto vertex = [&](int x, int y, int z) {
        const auto [entry, is_new] =
            vertex_of_cell.try_emplace(index(x, y, z), static_cast<int>(mesh.vertices.size()));
        if (is_new) mesh.vertices.push_back(point(x, y, z) + 0.5f * spacing * Vec3f{1, 1, 1});
        return entry->second;
    };
    for (int z = 1; z < size[2] - 1; ++z)
        for (int y = 1; y < size[1] - 1; ++y)
            for (int x = 1; x < size[0] - 1; ++x)
                for (int axis = 0; axis < 3; ++axis) {
                    const int to[3] = {x + (axis == 0), y + (axis == 1), z + (axis == 2)};
                    const bool from_inside = inside[index(x, y, z)];
                    if (from_inside == (inside[index(to[0], to[1], to[2])] != 0)) continue;
                    // The four cells around the edge, counter-clockwise seen from its far end.
                    int cells[4];
                    for (int k = 0; k < 4; ++k) {
                        int cell[3] = {x, y, z};
                        cell[(axis + 1) % 3] -= k == 0 || k == 3;
                        cell[(axis + 2) % 3] -= k == 0 || k == 1;
                        cells[k] = vertex(cell[0], cell[1], cell[2]);
                    }
                    if (!from_inside) std::swap(cells[1], cells[3]);
                    mesh.faces.push_back({cells[0], cells[1], cells[2]});
                    mesh.faces.push_back({cells[0], cells[2], cells[3]});
                }
    parallel_for(Cpu{}, static_cast<int>(mesh.vertices.size()), [&](int i) {
        for (int step = 0; step < 4; ++step) {
            const Vec3f slope = gradient(shape, mesh.vertices[i]);
            const float move =
                shape.distance(mesh.vertices[i]) / std::max(dot(slope, slope), 0.25f);
            // At most half a cell per step, because creases have no gradient.
            mesh.vertices[i] -= std::clamp(move, -0.5f * spacing, 0.5f * spacing) * slope;
        }
    });
    return mesh;
}

/// Flat disc in z = 0 made of rings of 6 i vertices: triangles of similar size.
inline TriangleMesh disc(float radius, float spacing) {
    TriangleMesh mesh;
    const int rings = static_cast<int>(std::ceil(radius / spacing));
    mesh.vertices.push_back({});
    const auto first = [](int ring) { return ring == 0 ? 0 : 1 + 3 * ring * (ring - 1); };
    for (int ring = 1; ring <= rings; ++ring) {
        for (int k = 0; k < 6 * ring; ++k) {
            const float angle = 6.2831853f * static_cast<float>(k) / static_cast<float>(6 * ring);
            const float r = radius * static_cast<float>(ring) / static_cast<float>(rings);
            mesh.vertices.push_back({r * std::cos(angle), r * std::sin(angle), 0});
        }
        const int inner_count = std::max(1, 6 * (ring - 1));
        for (int side = 0; side < 6; ++side)
            for (int k = 0; k < ring; ++k) {
                const auto outer = [&](int j) {
                    return first(ring) + (side * ring + j) % (6 * ring);
                };
                const auto inner = [&](int j) {
                    return first(ring - 1) + (side * (ring - 1) + j) % inner_count;
                };
                mesh.faces.push_back({inner(k), outer(k), outer(k + 1)});
                if (k + 1 < ring) mesh.faces.push_back({inner(k), outer(k + 1), inner(k + 1)});
            }
    }
    return mesh;
}

/// Smooth noise in [-1, 1], three independent channels: random values on a unit grid, interpolated.
inline Vec3f noise(Vec3f p, std::uint64_t seed, std::uint32_t octave) {
    const Vec3f cell{std::floor(p.x), std::floor(p.y), std::floor(p.z)}, f = p - cell;
    const auto fade = [](float t) { return t * t * t * (t * (t * 6 - 15) + 10); };
    Vec3f sum{};
    for (int corner = 0; corner < 8; ++corner) {
        std::uint64_t key = 0;
        float weight = 1;
        for (int c = 0; c < 3; ++c) {
            const int bit = corner >> c & 1;
            key =
                key << 20 | static_cast<std::uint64_t>(static_cast<int>(cell[c]) + bit + (1 << 19));
            weight *= bit ? fade(f[c]) : 1 - fade(f[c]);
        }
        const Random4 r = random4(seed, RandomStream::init, key, octave);
        sum += weight *
               Vec3f{2 * uniform(r.v[0]) - 1, 2 * uniform(r.v[1]) - 1, 2 * uniform(r.v[2]) - 1};
    }
    return sum;
}

/// Texture with detail at every scale from the object's size to 1/20 unit, so that photographs
/// match well.
inline Vec3f textured(Vec3f base, Vec3f p, std::uint64_t seed) {
    Vec3f detail{};
    std::uint32_t octave = 0;
    for (const float frequency : {2.5f, 5.0f, 10.0f, 20.0f}) {
        const Vec3f n = noise(frequency * p, seed, octave++);
        const float grey = 2 * n.x;  // mostly brightness, some hue
        detail += (octave == 1 ? 0.12f : 0.32f) * (0.65f * Vec3f{grey, grey, grey} + 0.25f * n);
    }
    Vec3f color = base * exp(detail);
    for (int c = 0; c < 3; ++c) color[c] = std::clamp(color[c], 0.04f, 0.98f);
    return color;
}

constexpr Vec3f kLight{0.7f, -0.5f, 1.1f};  // direction to the light, not of unit length

/// Share of the light along `direction` that reaches p, with soft shadow edges.
inline float light_reaching(const Shape& shape, Vec3f p, Vec3f direction) {
    float light = 1;
    for (float t = 0.03f; t < 2.5f;) {
        const float d = shape.distance(p + t * direction);
        light = std::min(light, 0.5f + 0.5f * 10 * d / t);
        if (light <= 0) return 0;
        t += std::clamp(d, 0.015f, 0.2f);
    }
    return light * light * (3 - 2 * light);
}

/// Ambient occlusion: nearby surfaces and the ground darken the ambient light.
inline float openness(const Shape& shape, Vec3f p, Vec3f normal, float ground_z) {
    float occlusion = 0, weight = 1;
    for (const float t : {0.04f, 0.1f, 0.2f, 0.35f}) {
        const Vec3f q = p + t * normal;
        occlusion += weight * std::max(0.0f, t - std::min(shape.distance(q), q.z - ground_z)) / t;
        weight *= 0.6f;
    }
    return std::clamp(1 - 0.4f * occlusion, 0.15f, 1.0f);
}

/// Colour of a surface point in the light: `base` with texture, of `contrast` from grey (0) to full
/// (1). `off`: distance from the surface at which the shadow ray begins.
inline Vec3f lit(const Shape& shape,
                 Vec3f p,
                 Vec3f normal,
                 float off,
                 float ground_z,
                 Vec3f base,
                 float contrast,
                 std::uint64_t seed) {
    const Vec3f to_light = normalize(kLight);
    const float diffuse = std::max(0.0f, dot(normal, to_light));
    const float reached = diffuse > 0 ? light_reaching(shape, p + off * normal, to_light) : 0;
    const float light = 0.75f * diffuse * reached +
                        0.45f * (0.8f + 0.2f * normal.z) * openness(shape, p, normal, ground_z);
    constexpr Vec3f kGrey{0.5f, 0.5f, 0.5f};
    Vec3f color = light * ((1 - contrast) * kGrey + contrast * textured(base, p, seed));
    for (int c = 0; c < 3; ++c) color[c] = std::min(color[c], 1.0f);
    return color;
}

/// Appends the vertices and faces of `part`.
inline void append(const TriangleMesh& part, TriangleMesh& mesh) {
    const int first = static_cast<int>(mesh.vertices.size());
    mesh.vertices.insert(mesh.vertices.end(), part.vertices.begin(), part.vertices.end());
    for (const Vec3i& face : part.faces)
        mesh.faces.push_back({face.x + first, face.y + first, face.z + first});
}

/// One coloured mesh of the object on its ground disc. Colours do not depend on the view. `texture`
/// is the contrast of the surface colours, from uniform grey (0) to full (1).
inline TriangleMesh make_scene_mesh(
    const Shape& shape, float ground_radius, float spacing, float texture, std::uint64_t seed) {
    TriangleMesh mesh = surface_nets(shape, spacing);
    const int object_vertices = static_cast<int>(mesh.vertices.size());
    append(disc(ground_radius, spacing), mesh);
    mesh.colors.resize(mesh.vertices.size());
    parallel_for(Cpu{}, static_cast<int>(mesh.vertices.size()), [&](int i) {
        const Vec3f p = mesh.vertices[i];
        const bool on_ground = i >= object_vertices;
        const Vec3f normal = on_ground ? Vec3f{0, 0, 1} : normalize(gradient(shape, p));
        const float tile = std::sin(5 * p.x) * std::sin(5 * p.y) > 0 ? 0.6f : 0.4f;
        const Vec3f base =
            on_ground ? Vec3f{0.95f * tile, tile, 0.85f * tile} : shape.base_color(p);
        mesh.colors[i] = lit(shape, p, normal, 0.01f, 0, base, texture, seed);
    });
    return mesh;
}

}  // namespace tvsgs::synth
