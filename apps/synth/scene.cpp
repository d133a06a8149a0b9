// Writes the scene of tvsgs-synth, file by file.
#include "core/scene/scene.h"

#include <iomanip>
#include <memory>
#include <numeric>
#include <optional>

#include "apps/synth/lens.h"
#include "apps/synth/photo.h"
#include "apps/synth/views.h"
#include "apps/synth/wide.h"
#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"
#include "core/progress.h"
#include "io/files/atomic_file.h"
#include "io/images/image_file.h"
#include "io/splats/ply.h"
#include "mesh/draw/mesh_render.h"
#include "pipeline/run/signals.h"

namespace tvsgs::synth {
namespace {

constexpr int kSupersampling = 3;
constexpr float kGroundRadius = 1.2f;
constexpr float kMeshSpacing = 0.01f;  // a fifth of the texture's finest detail

struct Sample {
    Vec3f position, normal, color;
    std::vector<int> views;
};

/// Independent points, uniform over the surface.
std::vector<Sample> sample_surface(const TriangleMesh& mesh, int count, std::uint64_t seed) {
    std::vector<double> area_up_to(mesh.faces.size());
    std::vector<Vec3f> normals(mesh.faces.size());
    double area = 0;
    for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
        const Vec3i face = mesh.faces[f];
        const Vec3f a = mesh.vertices[face.x];
        const Vec3f n = cross(mesh.vertices[face.y] - a, mesh.vertices[face.z] - a);
        area_up_to[f] = area += 0.5 * static_cast<double>(norm(n));
        normals[f] = normalize(n);
    }
    std::vector<Sample> samples(count);
    parallel_for(Cpu{}, count, [&](int i) {
        const Random4 r = random4(seed, RandomStream::sampling, i);
        const auto at =
            std::upper_bound(area_up_to.begin(), area_up_to.end() - 1, uniform(r.v[0]) * area);
        const auto f = at - area_up_to.begin();
        const float root = std::sqrt(uniform(r.v[1])), share = uniform(r.v[2]);
        const float weights[3] = {1 - root, root * (1 - share), root * share};
        Sample& sample = samples[i];
        for (int c = 0; c < 3; ++c) {
            sample.position += weights[c] * mesh.vertices[mesh.faces[f][c]];
            sample.color += weights[c] * mesh.colors[mesh.faces[f][c]];
        }
        sample.normal = normals[f];
    });
    return samples;
}

/// Image position of a world point.
struct Projected {
    Vec2f pixel;
    float depth;
};
Projected project(const Camera& camera, Vec3f point) {
    const Vec3f p = camera.camera_from_world * point;
    return {{camera.fx_px * p.x / p.z + camera.cx_px, camera.fy_px * p.y / p.z + camera.cy_px},
            p.z};
}

/// Z-buffer test with the farthest of 3 x 3 depths, so that slanted surfaces do not hide
/// themselves.
bool is_visible(const Sample& sample, const Camera& camera, const ImageF& depth) {
    const auto [pixel, z] = project(camera, sample.position);
    if (!(z > 0 && pixel.x >= 0 && pixel.y >= 0 && pixel.x < static_cast<float>(depth.width) &&
          pixel.y < static_cast<float>(depth.height)))
        return false;
    if (dot(normalize(camera_centre(camera) - sample.position), sample.normal) < 0.05f)
        return false;  // grazing
    const int x = static_cast<int>(pixel.x), y = static_cast<int>(pixel.y);
    float farthest = 0;
    for (int v = std::max(0, y - 1); v <= std::min(depth.height - 1, y + 1); ++v)
        for (int u = std::max(0, x - 1); u <= std::min(depth.width - 1, x + 1); ++u)
            farthest = std::max(farthest, depth.at(u, v));
    return z <= farthest + 0.1f * kMeshSpacing;
}

/// Renders and writes one photograph and its mask; marks the samples that the view sees.
void write_view(const std::string& out,
                const TriangleMesh& mesh,
                const Highlights* highlights,
                const SynthOptions& options,
                const Lens& lens,
                const std::vector<SynthView>& views,
                int i,
                std::vector<Sample>& points,
                std::vector<Sample>& truth) {
    const Camera fine = lens.pinhole(views[i].camera);
    MeshRender render = render_mesh(highlights ? highlights->seen_from(camera_centre(fine)) : mesh,
                                    fine, {.smooth_normals = false});
    for (std::vector<Sample>* const samples : {&points, &truth})
        parallel_for(Cpu{}, static_cast<int>(samples->size()), [&](int k) {
            Sample& sample = (*samples)[k];
            // The photograph shows less than the pinhole that covers it.
            if (is_visible(sample, fine, render.depth) &&
                lens.find(project(views[i].camera, sample.position).pixel))
                sample.views.push_back(i);
        });

    if (options.masks) {
        ImageF hit(fine.width_px, fine.height_px, 1);
        for (std::size_t k = 0; k < hit.pixels.size(); ++k)
            hit.pixels[k] = render.face.pixels[k] >= 0;
        ImageU8 mask = to_8bit(box_filter(lens.bent(hit), kSupersampling));
        for (std::uint8_t& value : mask.pixels) value = value > 127 ? 255 : 0;
        write_png(str(out, "/masks/", views[i].name), mask);
    }
    if (options.background == "sky") add_sky(render, fine, options.seed);
    if (options.background == "white") add_white(render);
    if (options.background == "noise") add_clutter(render, 2 * kSupersampling, options.seed, i);
    ImageF photo = box_filter(lens.bent(render.color), kSupersampling);
    for (float& value : photo.pixels)
        value *= static_cast<float>(exposure_gain(options.exposure_drift, i));
    add_noise(photo, static_cast<float>(options.noise), options.seed, i);
    write_png(str(out, "/images/", views[i].name), to_8bit(photo));
}

/// Point where the rays of the views that see a sample come closest, with the poses of `given`.
Vec3f triangulated(const Sample& point,
                   const std::vector<SynthView>& views,
                   const std::vector<SynthView>& given) {
    Mat3<double> A{};
    Vec3d b;
    for (const int i : point.views) {
        const auto at = static_cast<std::size_t>(i);
        const Rigid3d world_from_camera = inverse(given[at].pose());
        const Vec3d ray =
            world_from_camera.R * normalize(views[at].pose() * vec_cast<double>(point.position));
        for (int r = 0; r < 3; ++r)
            for (int c = 0; c < 3; ++c) {
                const double across = (r == c ? 1 : 0) - ray[r] * ray[c];
                A[r][c] += across, b[r] += across * world_from_camera.t[c];
            }
    }
    const Vec3d x = column(A, 0), y = column(A, 1), z = column(A, 2);
    return vec_cast<float>(Vec3d{dot(b, cross(y, z)), dot(x, cross(b, z)), dot(x, cross(y, b))} /
                           dot(x, cross(y, z)));
}

/// COLMAP's text model with the poses of `given`. Points are slightly off, like triangulated ones;
/// their image positions are exact.
void write_colmap(const std::string& folder,
                  const std::vector<SynthView>& views,
                  const std::vector<SynthView>& given,
                  const Lens& lens,
                  const std::vector<Sample>& points,
                  std::uint64_t seed) {
    std::ostringstream cameras, images, cloud;
    cameras << std::setprecision(17) << "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n";
    images << std::setprecision(17) << "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"
           << "# POINTS2D[] as (X, Y, POINT3D_ID)\n";
    cloud << std::setprecision(9)
          << "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n";

    cameras << "1 " << lens.colmap() << '\n';

    std::vector<std::ostringstream> observations(views.size());
    std::vector<int> observation_count(views.size());
    for (std::size_t k = 0; k < points.size(); ++k) {
        const Sample& point = points[k];
        const Vec3f seen_at = &given == &views ? point.position : triangulated(point, views, given);
        const Vec3f p = seen_at + 0.003f * normal3(random4(seed, RandomStream::init, k, 1));
        cloud << k + 1 << ' ' << p.x << ' ' << p.y << ' ' << p.z;
        for (int c = 0; c < 3; ++c) cloud << ' ' << std::lround(255 * point.color[c]);
        cloud << " 0.5";
        for (const int view : point.views) {
            const Vec2<double> place =
                *lens.find(project(views[view].camera, point.position).pixel);
            cloud << ' ' << view + 1 << ' ' << observation_count[view]++;
            observations[view] << (observation_count[view] > 1 ? " " : "") << place.x << ' '
                               << place.y << ' ' << k + 1;
        }
        cloud << '\n';
    }
    for (std::size_t i = 0; i < given.size(); ++i) {
        const SynthView& view = given[i];
        images << i + 1 << ' ' << view.quat.w << ' ' << view.quat.x << ' ' << view.quat.y << ' '
               << view.quat.z << ' ' << view.translation.x << ' ' << view.translation.y << ' '
               << view.translation.z << " 1 " << view.name << '\n'
               << observations[i].str() << '\n';
    }
    write_text_file(folder + "/cameras.txt", cameras.str());
    write_text_file(folder + "/images.txt", images.str());
    write_text_file(folder + "/points3D.txt", cloud.str());
}

/// The samples that at least two of `views` see.
PointCloud seen_twice(const std::vector<Sample>& samples, const std::vector<int>& views) {
    PointCloud cloud;
    for (const Sample& sample : samples) {
        const auto seen = std::ranges::count_if(
            sample.views, [&](int view) { return std::ranges::binary_search(views, view); });
        if (seen < 2) continue;
        cloud.positions.push_back(sample.position);
        cloud.normals.push_back(sample.normal);
        cloud.colors.push_back(sample.color);
    }
    return cloud;
}

std::string info_json(const SynthOptions& options, std::size_t points, std::size_t points_train_3) {
    std::ostringstream out;
    out << "{\n"
        << "  \"generator\": \"tvsgs-synth\",\n"
        << "  \"shape\": \"" << (options.wide > 0 ? "wide" : options.shape) << "\",\n"
        << "  \"seed\": " << options.seed << ",\n"
        << "  \"units\": \"1\",\n";
    if (options.wide > 0) {
        const double half = 0.5 * options.wide;
        out << "  \"box\": [[" << -half << ", " << -half << ", -0.6], [" << half << ", " << half
            << ", 2.6]],\n"
            << "  \"thresholds\": [0.02, 0.05, 0.1],\n"
            << "  \"max_dist\": 0.4,\n";
    } else {
        out << "  \"crop_cylinder\": {\"center_xy\": [0, 0], \"radius\": " << kGroundRadius
            << ", \"z_min\": -0.1, \"z_max\": 2.2},\n"
            << "  \"ground_plane_z\": 0,\n"
            << "  \"thresholds\": [0.01, 0.02, 0.05],\n"
            << "  \"max_dist\": 0.2,\n";
    }
    out << "  \"points\": " << points << ",\n"
        << "  \"points_train_3\": " << points_train_3;
    if (options.exposure_drift > 0) {
        out << std::setprecision(9) << ",\n  \"exposure_gains\": [";  // in the order of the names
        for (int i = 0; i < options.views; ++i)
            out << (i ? ", " : "") << exposure_gain(options.exposure_drift, i);
        out << ']';
    }
    out << "\n}\n";
    return out.str();
}

std::string readme(const SynthOptions& options) {
    return str(
        "# Synthetic scene '", options.wide > 0 ? "wide" : options.shape,
        "', written by tvsgs-synth\n\n", options.views, " views, ", options.width, "x",
        options.height, ", seed ", options.seed, ", sensor noise ", options.noise, " of 255",
        options.wide > 0
            ? str(".\nObjects up to 2 units high on a ground with relief, ", options.wide, " x ",
                  options.wide, " units around the origin, z up; cameras at two heights.\n")
            : str(", arc ", options.arc_deg,
                  " degrees.\nUnits: the object is about 2 units high; the ground is the plane z = "
                  "0, z up, the object's front looks along +x.\n"),
        options.shininess > 0
            ? str("Highlights of strength ", options.shininess,
                  " move with the view point; the colours of mesh and points are without.\n")
            : "The light is baked into the colours: they do not change with the view point.\n",
        options.exposure_drift > 0
            ? "The photographs are brighter and darker by `exposure_gains` of `gt/info.json`.\n"
            : "",
        options.texture < 1
            ? str("The contrast of the surface's own colours is ", options.texture, ".\n")
            : "",
        "\n- `images/`", options.masks ? ", `masks/`" : "", " (object and ground against ",
        options.background == "sky"     ? "a sky infinitely far away"
        : options.background == "white" ? "overexposed white"
        : options.background == "noise" ? "greys that no two views share"
                                        : "the empty background",
        R"()
- `sparse/0/`: COLMAP text model; )",
        options.pose_noise > 0
            ? str("the poses of all views but `test` are off by about ", options.pose_noise,
                  " pixels, the exact ones are in `gt/sparse/`")
            : std::string("exact poses"),
        R"(, pixel centres at .5; points3D.txt are surface samples with a
  little noise (standard deviation 0.003), their tracks the views that see them
- `splits.json`: `train_3` (around the front, or the middle), `train_9`, `train_all`, `test`; no test view is in a training list
- `gt/mesh.ply`: the exact surface, hidden parts included (under the object)
- `gt/points.ply`: uniform samples of what at least two views see; `gt/points_train_3.ply`: at least two of `train_3`
- `gt/info.json`: crop volume for `tvsgs-eval geometry --crop`
)");
}

}  // namespace

void write_scene(const SynthOptions& options, const std::string& out) {
    const Shape shape = make_shape(options.shape);
    std::optional<WideScene> wide;
    if (options.wide > 0) wide.emplace(static_cast<float>(options.wide), options.seed);
    const auto texture = static_cast<float>(options.texture);
    const TriangleMesh mesh =
        wide ? wide->mesh(texture)
             : make_scene_mesh(shape, kGroundRadius, kMeshSpacing, texture, options.seed);
    std::unique_ptr<Highlights> highlights;
    if (options.shininess > 0)
        highlights =
            std::make_unique<Highlights>(shape, mesh, static_cast<float>(options.shininess));
    std::vector<SynthView> views = wide ? make_wide_views(options, *wide) : make_views(options);
    const Lens lens(options.lens, views.front().camera, kSupersampling);
    for (SynthView& view : views) view.camera.fy_px = lens.fy_px();
    std::vector<Sample> points = sample_surface(mesh, options.points, options.seed);
    std::vector<Sample> truth = sample_surface(mesh, 100000, options.seed + 1);
    Progress progress("views", options.views);
    for (int i = 0; i < options.views; ++i, progress.advance()) {
        SignalGuard::check();
        write_view(out, mesh, highlights.get(), options, lens, views, i, points, truth);
        if (!options.priors.format.empty()) write_priors(out, mesh, options, views[i], i);
    }
    finish_priors(out, mesh, options, views);

    std::erase_if(points, [](const Sample& point) { return point.views.size() < 2; });
    const Splits splits = make_splits(views, options.test_views);
    const bool exact = !(options.pose_noise > 0);
    write_colmap(out + (exact ? "/sparse/0" : "/gt/sparse"), views, views, lens, points,
                 options.seed);
    if (!exact)
        write_colmap(out + "/sparse/0", views,
                     moved_views(views, splits.train_all, options.pose_noise, options.seed), lens,
                     points, options.seed);
    write_text_file(out + "/splits.json", splits_json(splits, views));
    std::vector<int> all(views.size());
    std::iota(all.begin(), all.end(), 0);
    const PointCloud seen = seen_twice(truth, all), seen_3 = seen_twice(truth, splits.train_3);
    write_mesh_ply(out + "/gt/mesh.ply", mesh);
    write_cloud_ply(out + "/gt/points.ply", seen);
    if (!splits.train_3.empty()) write_cloud_ply(out + "/gt/points_train_3.ply", seen_3);
    write_text_file(out + "/gt/info.json",
                    info_json(options, seen.positions.size(), seen_3.positions.size()));
    write_text_file(out + "/README.md", readme(options));
    spdlog::info("{}: {} photographs, {}x{}; {} start points; true surface of {} faces",
                 options.out, options.views, options.width, options.height, grouped(points.size()),
                 grouped(mesh.faces.size()));
}

}  // namespace tvsgs::synth
