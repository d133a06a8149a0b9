#include <zlib.h>

#include <filesystem>
#include <limits>

#include "apps/synth/views.h"
#include "core/error.h"
#include "core/math/rng.h"
#include "io/files/atomic_file.h"
#include "io/files/npz.h"
#include "io/images/image_file.h"
#include "mesh/draw/mesh_render.h"

namespace tvsgs::synth {
namespace {

namespace fs = std::filesystem;
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

/// Exact maps of a view; NaN without surface, 0 for normals.
struct PriorMaps {
    Camera camera;
    ImageF z, depth, normal;  // depth: in the stored quantity
    float low = 0, high = 1;  // range of `depth`
};

/// The central square at 384 pixels, the input of Omnidata.
Camera centre_crop(Camera camera) {
    constexpr int kSide = 384;
    const int side = std::min(camera.width_px, camera.height_px);
    const float scale = static_cast<float>(kSide) / static_cast<float>(side);
    camera.cx_px = scale * (camera.cx_px - 0.5f * static_cast<float>(camera.width_px - side));
    camera.cy_px = scale * (camera.cy_px - 0.5f * static_cast<float>(camera.height_px - side));
    camera.fx_px *= scale, camera.fy_px *= scale;
    camera.width_px = camera.height_px = kSide;
    return camera;
}

Vec3f framed(const SynthPriors& options, const Camera& camera, Vec3f n) {
    if (options.format == "acmm" || options.frame == "world")
        n = transpose_times(camera.camera_from_world.R, n);
    else if (options.frame == "camera_opengl")
        n = {n.x, -n.y, -n.z};
    return options.normals_away ? -n : n;
}

PriorMaps make_maps(const TriangleMesh& mesh,
                    const SynthOptions& options,
                    const SynthView& view,
                    int index) {
    const SynthPriors& priors = options.priors;
    PriorMaps maps;
    maps.camera = priors.format == "omnidata" ? centre_crop(view.camera) : view.camera;
    MeshRender render = render_mesh(mesh, maps.camera, {.smooth_normals = false});
    maps.z = maps.depth = std::move(render.depth), maps.normal = std::move(render.normal);
    maps.low = std::numeric_limits<float>::infinity(), maps.high = -maps.low;
    constexpr int kBlock = 8;  // side of a square of missing pixels
    for (int y = 0; y < maps.depth.height; ++y)
        for (int x = 0; x < maps.depth.width; ++x) {
            const auto random = [&](int column, int row, std::uint32_t sub) {
                const auto key = static_cast<std::uint64_t>(index) << 40 |
                                 static_cast<std::uint64_t>(row) << 20 |
                                 static_cast<std::uint64_t>(column);
                return random4(options.seed, RandomStream::test, key, sub);
            };
            float& depth = maps.depth.at(x, y);
            const Vec3f ray = pixel_ray(maps.camera, x, y);
            float* const pixel = &maps.normal.at(x, y);
            const bool hole =
                static_cast<double>(uniform(random(x / kBlock, y / kBlock, 1).v[0])) < priors.holes;
            if (!(depth > 0) || hole) {
                maps.z.at(x, y) = depth = kNaN;
                std::fill_n(pixel, 3, 0.f);
                continue;
            }
            Vec3f n{pixel[0], pixel[1], pixel[2]};
            n = framed(priors, maps.camera, dot(n, ray) > 0 ? -n : n);
            for (int c = 0; c < 3; ++c) pixel[c] = n[c];
            float z = depth * (1 + static_cast<float>(priors.noise) * normal3(random(x, y, 2)).x);
            if (priors.ray) z *= norm(ray);
            depth = priors.quantity == "inverse_depth" ? 1 / z
                    : priors.quantity == "log_depth"   ? std::log(z)
                                                       : z;
            maps.low = std::min(maps.low, depth), maps.high = std::max(maps.high, depth);
        }
    return maps;
}

/// Numbers times `factor` plus `offset`; `none` for NaN.
ImageF mapped(const ImageF& from, float factor, float offset, float none) {
    ImageF to = from;
    for (float& value : to.pixels) value = std::isnan(value) ? none : factor * value + offset;
    return to;
}

void write_array(const std::string& path, const ImageF& map) {
    std::vector<std::int64_t> shape{map.height, map.width};
    if (map.channels > 1) shape.push_back(map.channels);
    write_npy(path, shape, map.pixels.data());
}

/// In the order [C H W].
ImageF planar(const ImageF& map) {
    ImageF out = map;
    std::size_t i = 0;
    for (int c = 0; c < map.channels; ++c)
        for (int y = 0; y < map.height; ++y)
            for (int x = 0; x < map.width; ++x) out.pixels[i++] = map.at(x, y, c);
    return out;
}

/// [C H W], the layout of networks.
void write_planar(const std::string& path, const ImageF& map) {
    write_npy(path, {map.channels, map.height, map.width}, planar(map).pixels.data());
}

template <class List>
std::string bytes_of(const List& values) {
    return {reinterpret_cast<const char*>(std::data(values)),
            std::size(values) * sizeof(*std::data(values))};
}

void write_dmb(const std::string& path, const ImageF& map) {
    const std::int32_t head[] = {1, map.height, map.width, map.channels};
    write_text_file(path, bytes_of(head) + bytes_of(map.pixels));
}

void write_colmap_map(const std::string& path, const ImageF& map) {
    write_text_file(path, str(map.width, '&', map.height, '&', map.channels, '&') +
                              bytes_of(planar(map).pixels));
}

void write_pfm(const std::string& path, const ImageF& map) {
    ImageF turned = map;
    for (int y = 0; y < map.height; ++y)
        std::copy_n(&map.at(0, map.height - 1 - y), map.width, &turned.at(0, y));
    write_text_file(path,
                    str("Pf\n", map.width, ' ', map.height, "\n-1.0\n") + bytes_of(turned.pixels));
}

/// The lowest 32 bits, the highest byte first.
std::string big_endian(std::size_t value) {
    std::string bytes;
    for (int shift = 24; shift >= 0; shift -= 8) bytes += static_cast<char>(value >> shift & 255);
    return bytes;
}

/// 16-bit grey; our own PNG writer has only 8 bits.
void write_png16(const std::string& path, const ImageF& map) {
    std::string rows;
    for (int y = 0; y < map.height; ++y) {
        rows += '\0';
        for (int x = 0; x < map.width; ++x) {
            const long value = std::clamp(std::lround(map.at(x, y)), 0L, 65535L);
            rows += {static_cast<char>(value >> 8), static_cast<char>(value & 255)};
        }
    }
    uLongf size = compressBound(rows.size());
    std::string packed(size, '\0');
    compress(reinterpret_cast<Bytef*>(packed.data()), &size,
             reinterpret_cast<const Bytef*>(rows.data()), rows.size());
    packed.resize(size);
    const auto chunk = [](std::string data) {
        const uLong sum =
            crc32(0, reinterpret_cast<const Bytef*>(data.data()), static_cast<uInt>(data.size()));
        return big_endian(data.size() - 4) + data + big_endian(sum);
    };
    write_text_file(path, "\x89PNG\r\n\x1a\n" +
                              chunk("IHDR" + big_endian(map.width) + big_endian(map.height) +
                                    std::string("\x10\0\0\0\0", 5)) +
                              chunk("IDAT" + packed) + chunk("IEND"));
}

/// Eight numbers that depend only on the world position, so they agree between views.
ImageF features_of(const PriorMaps& maps) {
    ImageF out(maps.z.width / 2, maps.z.height / 2, 8);
    const Rigid3f world_from_camera = inverse(maps.camera.camera_from_world);
    for (int y = 0; y < out.height; ++y)
        for (int x = 0; x < out.width; ++x) {
            const float z = maps.z.at(2 * x, 2 * y);
            if (!(z > 0)) continue;
            const Vec3f p = world_from_camera * (z * pixel_ray(maps.camera, 2 * x, 2 * y));
            for (int c = 0; c < 8; ++c) {
                const float turn = (c < 4 ? 3.f : 11.f) * p[c % 3] + static_cast<float>(c);
                out.at(x, y, c) = std::sin(turn);
            }
        }
    return out;
}

std::string stem_of(const SynthView& view) {
    return fs::path(view.name).stem().string();
}

/// Scale of 3DGS's 16-bit range, in 1 / depth.
float png_scale(const PriorMaps& maps) {
    return (1 / maps.low - 1 / maps.high) * 65536 / 65535;
}

}  // namespace

void write_priors(const std::string& out,
                  const TriangleMesh& mesh,
                  const SynthOptions& options,
                  const SynthView& view,
                  int index) {
    const std::string& format = options.priors.format;
    const PriorMaps maps = make_maps(mesh, options, view, index);
    const std::string stem = stem_of(view);
    const auto scale = static_cast<float>(options.priors.scale);
    const float spread = 1 / (maps.high - maps.low);
    const auto path = [&](const std::string& name) { return str(out, "/", name); };
    if (format == "npy") {
        write_array(path(str("depth_npy/", stem, "_pred.npy")),
                    mapped(maps.depth, spread, -maps.low * spread, kNaN));
        write_array(path(str("normal/", stem, "_normal.npy")), maps.normal);
        write_planar(path(str("features/", stem, ".npy")), features_of(maps));
    } else if (format == "vggt") {
        write_array(path(str("depth_vggt/", stem, "_pred.npy")),
                    mapped(maps.depth, 0.37f * scale, 0, 0));
        write_array(path(str("depth_vggt/", stem, "_conf.npy")), mapped(maps.depth, 0, 5, 1));
        write_array(path(str("normal/", stem, "_normal.npy")), maps.normal);
    } else if (format == "params") {
        const float low = 1 / maps.high;
        ImageF inverse = maps.depth;
        for (float& value : inverse.pixels)
            value = value > 0 ? (1 / value - low) / png_scale(maps) * 65536 : 0;
        write_png16(path(str("depths/", stem, ".png")), inverse);
    } else if (format == "colmap") {
        write_colmap_map(path(str("stereo/depth_maps/", view.name, ".geometric.bin")),
                         mapped(maps.depth, scale, 0, 0));
        write_colmap_map(path(str("stereo/normal_maps/", view.name, ".geometric.bin")),
                         maps.normal);
    } else if (format == "mvsnet") {
        const std::string name = str("0000", stem, ".pfm");
        write_pfm(path("depth_est/" + name), mapped(maps.depth, scale, 0, 0));
        write_pfm(path("confidence/" + name), mapped(maps.depth, 0, 0.8f, 0));
    } else if (format == "acmm") {
        const std::string folder = str("ACMM/2333_0000", stem, "/");
        write_dmb(path(folder + "depths_geom.dmb"), mapped(maps.depth, scale, 0, 0));
        write_dmb(path(folder + "normals.dmb"), maps.normal);
    } else if (format == "omnidata") {
        write_array(path(str("omnidata/", stem, "_depth.npy")),
                    mapped(maps.depth, spread, -maps.low * spread, kNaN));
        write_planar(path(str("omnidata/", stem, "_normal.npy")),
                     mapped(maps.normal, 0.5f, 0.5f, 0.5f));
    } else {
        write_array(path(str("priors/depth/", stem, ".npy")), mapped(maps.depth, scale, 0, kNaN));
        write_array(path(str("priors/normal/", stem, ".npy")), maps.normal);
    }
    if (options.background == "sky") {
        ImageU8 sky(view.camera.width_px, view.camera.height_px, 1);
        const ImageF depth = render_mesh(mesh, view.camera).depth;
        for (std::size_t i = 0; i < sky.pixels.size(); ++i)
            sky.pixels[i] = depth.pixels[i] > 0 ? 0 : 255;
        write_png(path(str(format == "json" ? "priors/" : "", "sky/", stem, ".png")), sky);
    }
}

void finish_priors(const std::string& out,
                   const TriangleMesh& mesh,
                   const SynthOptions& options,
                   const std::vector<SynthView>& views) {
    const SynthPriors& priors = options.priors;
    if (priors.format == "params") {
        std::string text = "{";
        for (int i = 0; i < options.views; ++i) {
            const SynthView& view = views[i];
            const PriorMaps maps = make_maps(mesh, options, view, i);
            text += str(i > 0 ? ",\n " : "", '"', stem_of(view),
                        "\": {\"scale\": ", static_cast<double>(png_scale(maps)) * priors.scale,
                        ", \"offset\": ", static_cast<double>(1 / maps.high) * priors.scale, "}");
        }
        write_text_file(out + "/sparse/0/depth_params.json", text + "}\n");
    }
    if (priors.format != "json") return;
    const std::string sky = options.background == "sky" ? R"(,
  "sky": {"dir": "sky"})"
                                                        : "";
    write_text_file(
        out + "/priors/priors.json",
        str(R"({"version": 1,
  "depth": {"dir": "depth", "encoding": "npy")",
            priors.declare.empty() ? "" : str(R"(, "quantity": ")", priors.declare, '"'),
            R"(, "alignment": "affine", "producer": "tvsgs-synth"},
  "normal": {"dir": "normal", "encoding": "npy", "layout": "hwc", "range": "signed"})",
            sky, "}\n"));
}

}  // namespace tvsgs::synth
