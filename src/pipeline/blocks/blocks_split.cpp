#include "pipeline/blocks/blocks_split.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/grouped.h"
#include "core/math/point_tree.h"
#include "core/math/quantile.h"
#include "core/progress.h"
#include "io/files/read_file.h"
#include "render/tiles/sh_math.h"

namespace tvsgs {
namespace {

constexpr std::size_t kSample = 2000;  // splats at which distances are measured
constexpr double kLeastShare = 0.1;    // of a view's pixels, to make it a view of a block
constexpr double kFarBox = 1.5;        // factor to the box of 1 to 99 % of the coarse splats
// Margins: share of a cell's shortest side, number of vote reaches, number of mesh voxels (four
// truncations of four voxels).
constexpr double kMarginSides = 0.15, kMarginReaches = 3, kMarginVoxels = 16;

/// About `most` of `count` indices, evenly spaced.
std::vector<std::size_t> even_choice(std::size_t count, std::size_t most) {
    std::vector<std::size_t> chosen;
    const std::size_t step = std::max<std::size_t>(1, (count + most - 1) / most);
    for (std::size_t i = 0; i < count; i += step) chosen.push_back(i);
    return chosen;
}

Vec3d mean_of(const Gaussians<Cpu>& splats, std::size_t i) {
    return vec_cast<double>(splats.means[i]);
}

Box3d near_box(const GroundFrame& frame, const Gaussians<Cpu>& coarse) {
    std::vector<double> along[3];
    for (std::size_t i = 0; i < coarse.means.size(); ++i) {
        const Vec3d p = frame.ground_from_world * mean_of(coarse, i);
        for (int axis = 0; axis < 3; ++axis) along[axis].push_back(p[axis]);
    }
    // The same margin on all sides: a tower may rise above a flat scene.
    Box3d box;
    double largest = 0;
    for (int axis = 0; axis < 3; ++axis) {
        box.low[axis] = quantile(along[axis], 0.01), box.high[axis] = quantile(along[axis], 0.99);
        largest = std::max(largest, box.high[axis] - box.low[axis]);
    }
    const double more = 0.5 * (kFarBox - 1) * largest;
    for (int axis = 0; axis < 3; ++axis) box.low[axis] -= more, box.high[axis] += more;
    return box;
}

/// Number of fine splats that may replace a coarse one: one per pixel of its area.
double finer_splats(Vec3f log_scale, double pixel) {
    float l[3] = {log_scale.x, log_scale.y, log_scale.z};
    std::sort(l, l + 3);
    const double area = 9 * std::exp(double(l[1] + l[2]));  // 3 x 3 deviations
    return std::clamp(area / (pixel * pixel), 1.0, 16.0);
}

/// Reach of a vote that 95 % of the splats do not exceed, estimated from coarse splats and scaled
/// to `denser` times as many.
double vote_reach(const std::vector<Vec3f>& means, int k, double denser) {
    const std::size_t wanted = std::min(means.size(), std::size_t(2 * k) + 1);
    const PointTree<float> tree(means);
    std::vector<double> reach;
    std::vector<std::size_t> index(wanted);
    std::vector<float> squared(wanted);
    for (const std::size_t i : even_choice(means.size(), kSample)) {
        const std::size_t found = tree.nearest(means[i], wanted, index.data(), squared.data());
        reach.push_back(std::sqrt(double(squared[found - 1])));
    }
    return quantile(reach, 0.95) / std::sqrt(denser);
}

double shortest_side(const GroundCell& cell, const Box3d& near) {
    double side = GroundCell::kInfinite;
    for (int axis = 0; axis < 2; ++axis)
        side = std::min(side, std::min(cell.high[axis], near.high[axis]) -
                                  std::max(cell.low[axis], near.low[axis]));
    return side;
}

/// Whether a sphere may appear in an image.
bool may_be_visible(const Camera& camera, Vec3f centre, float radius) {
    const Vec3f p = camera.camera_from_world * centre;
    if (!(p.z + radius > 0)) return false;
    if (!(p.z > radius)) return true;  // the camera may be inside
    // Planes through the camera's centre and the image's edges.
    const auto outside = [&](float f, float c, float size, float at) {
        const float left = f * at + c * p.z, right = (size - c) * p.z - f * at;
        return left < -radius * std::hypot(f, c) || right < -radius * std::hypot(f, size - c);
    };
    return !outside(camera.fx_px, camera.cx_px, float(camera.width_px), p.x) &&
           !outside(camera.fy_px, camera.cy_px, float(camera.height_px), p.y);
}

bool is_near(const BlocksManifest& m, Vec3d world) {
    return m.block_of(world) > 0;
}

/// Samples the coarse splats of each cell evenly, to count the views that see them.
std::vector<std::vector<int>> counted_splats(const Gaussians<Cpu>& coarse,
                                             const BlocksManifest& manifest) {
    constexpr std::size_t kMost = 20000;
    std::vector<std::vector<int>> all(std::size_t(manifest.count()));
    for (std::size_t i = 0; i < coarse.means.size(); ++i)
        if (const int block = manifest.block_of(mean_of(coarse, i)); block > 0)
            all[block - 1].push_back(int(i));
    for (std::vector<int>& of : all) {
        std::vector<int> chosen;
        for (const std::size_t k : even_choice(of.size(), kMost)) chosen.push_back(of[k]);
        of = std::move(chosen);
    }
    return all;
}

/// Adds to each block how much of it view `v` sees. `depth`: for the rays of `camera`.
void add_block_view(const Gaussians<Cpu>& coarse,
                    const BlocksManifest& manifest,
                    const std::vector<std::vector<int>>& counted,
                    const Camera& camera,
                    const std::vector<float>& depth,
                    std::size_t v,
                    std::vector<std::vector<BlockView>>& looks) {
    const Rigid3f world_from_camera = inverse(camera.camera_from_world);
    std::vector<std::size_t> pixels(manifest.cells.size());
    std::size_t with_depth = 0;
    for (int y = 0; y < camera.height_px; ++y)
        for (int x = 0; x < camera.width_px; ++x) {
            const float z = depth[std::size_t(y) * camera.width_px + x];
            if (!(z > 0)) continue;
            ++with_depth;
            const Vec3d p = vec_cast<double>(world_from_camera * (z * pixel_ray(camera, x, y)));
            if (!is_near(manifest, p)) continue;
            const Vec2<double> place = manifest.frame.on_ground(p);
            for (std::size_t b = 0; b < manifest.cells.size(); ++b)
                pixels[b] += manifest.cells[b].distance(place) < manifest.margin;
        }
    for (std::size_t b = 0; b < manifest.cells.size(); ++b) {
        BlockView& look = looks[b][v];
        look.share = with_depth == 0 ? 0 : double(pixels[b]) / double(with_depth);
        for (std::size_t k = 0; k < counted[b].size(); ++k) {
            const Vec3f mean = coarse.means[counted[b][k]];
            if (!is_in_view(camera, mean)) continue;
            const Vec3f p = camera.camera_from_world * mean;
            const int x = int(camera.fx_px * p.x / p.z + camera.cx_px),
                      y = int(camera.fy_px * p.y / p.z + camera.cy_px);
            const float z = depth[std::size_t(y) * camera.width_px + x];
            // The splat is not hidden: it lies within its own thickness of the rendered surface.
            if (p.z < 1.05f * z) look.sees.push_back(int(k));
        }
    }
}

}  // namespace

void plan_cells(const Scene& scene,
                const Gaussians<Cpu>& coarse,
                const RunOptions& options,
                const SplitOptions& split,
                double finer,
                double expected,
                BlocksManifest& manifest) {
    const std::vector<Camera> cameras = detail::cameras_of(scene.train);
    std::vector<Vec3d> centres;
    for (const Camera& camera : cameras) centres.push_back(vec_cast<double>(camera_centre(camera)));
    manifest.origin = scene.origin;
    manifest.frame = ground_frame(split.up ? *split.up : up_of(centres));
    manifest.near = near_box(manifest.frame, coarse);
    manifest.cells = {GroundCell{}};

    std::vector<Vec2<double>> places;  // of the near splats, as the other lists
    std::vector<Vec3f> means, log_scales;
    for (std::size_t i = 0; i < coarse.means.size(); ++i) {
        if (!is_near(manifest, mean_of(coarse, i))) continue;
        places.push_back(manifest.frame.on_ground(mean_of(coarse, i)));
        means.push_back(coarse.means[i]), log_scales.push_back(coarse.log_scales[i]);
    }
    std::vector<double> weights(means.size()), pixels(means.size());
    parallel_for(Cpu{}, int(means.size()), [&](int i) {
        pixels[i] = double(finest_pixel(cameras, means[i])) / finer;
        weights[i] = finer_splats(log_scales[i], pixels[i]);
    });
    const double total = std::accumulate(weights.begin(), weights.end(), 0.0);
    manifest.voxel_size = options.mesh.meshers.tsdf.voxel_size > 0
                              ? double(options.mesh.meshers.tsdf.voxel_size)
                              : quantile(pixels, 0.5);

    const double denser = std::max(1.0, expected / double(means.size()));
    const double reach = vote_reach(means, options.train.tv.k, denser);

    // Cells shrink until they fit with their margins, which depend on the cells.
    const auto margin_of = [&](const std::vector<GroundCell>& cells) {
        if (split.margin > 0) return split.margin;
        double margin = kMarginVoxels * manifest.voxel_size, side = GroundCell::kInfinite;
        for (const GroundCell& cell : cells)
            side = std::min(side, shortest_side(cell, manifest.near));
        if (options.train.tv.enabled) margin = std::max(margin, kMarginReaches * reach);
        return std::max(margin, kMarginSides * side);
    };
    const auto heaviest = [&](const std::vector<GroundCell>& cells, double margin) {
        double most = 0;
        for (const GroundCell& cell : cells) {
            double weight = 0;
            for (std::size_t i = 0; i < places.size(); ++i)
                if (cell.distance(places[i]) < margin) weight += weights[i];
            most = std::max(most, weight);
        }
        return most / total * expected;
    };
    for (int count = std::max(1, split.blocks);; ++count) {
        manifest.cells = split_cells(places, weights, count, 0);
        manifest.margin = margin_of(manifest.cells);
        if (split.blocks > 0) break;
        const double most = heaviest(manifest.cells, manifest.margin);
        if (most <= double(split.max_splats)) break;
        if (count >= 4096 ||
            (count > 1 && shortest_side(manifest.cells.front(), manifest.near) < manifest.margin))
            throw input_error("--max-splats ", split.max_splats, ": even ", count, " blocks need ",
                              grouped(std::int64_t(most)), " splats each, with margins of ",
                              manifest.margin,
                              "; give a larger --max-splats or a smaller --margin");
    }
}

std::vector<std::vector<BlockView>> find_block_views(const DeviceChoice& device,
                                                     const Scene& scene,
                                                     const Gaussians<Cpu>& coarse,
                                                     const TrainOptions& options,
                                                     const BlocksManifest& manifest) {
    std::vector<std::vector<BlockView>> looks(manifest.cells.size(),
                                              std::vector<BlockView>(scene.train.size()));
    const auto counted = counted_splats(coarse, manifest);
    Progress progress("views per block", double(scene.train.size()));
    on_device(device, [&]<class Device>(Device) {
        const auto backbone = make_backbone<Device>(options.backbone, options.render);
        Gaussians<Device> splats;
        copy(coarse, splats);
        for (std::size_t v = 0; v < scene.train.size(); ++v) {
            progress.advance();
            const auto& images = backbone->forward(splats, scene.train[v].camera, 0, kGeometryMaps);
            add_block_view(coarse, manifest, counted, images.camera, to_host(images.depth), v,
                           looks);
        }
    });
    return looks;
}

std::vector<BlockContents> fill_blocks(const Scene& scene,
                                       const Gaussians<Cpu>& coarse,
                                       const BlocksManifest& manifest,
                                       double expected,
                                       const std::vector<std::vector<BlockView>>& looks) {
    constexpr std::size_t kFewPoints = 100;
    const auto counted = counted_splats(coarse, manifest);
    const auto belongs = [&](const GroundCell& cell, Vec3d p) {
        return is_near(manifest, p) && cell.distance(manifest.frame.on_ground(p)) < manifest.margin;
    };
    std::vector<BlockContents> blocks(manifest.cells.size());
    for (std::size_t b = 0; b < blocks.size(); ++b) {
        BlockContents& block = blocks[b];
        const GroundCell& cell = manifest.cells[b];
        block.views = choose_block_views(looks[b], int(counted[b].size()), kLeastShare);
        if (block.views.size() < 2)
            throw input_error("block ", b + 1, ": ", block.views.size(),
                              " photographs show its cell, expected at least 2; give fewer blocks");

        std::vector<Camera> cameras;
        for (const int v : block.views) cameras.push_back(scene.train[v].camera);
        std::vector<int> inside;
        for (std::size_t i = 0; i < coarse.means.size(); ++i) {
            if (belongs(cell, mean_of(coarse, i))) {
                inside.push_back(int(i));
                continue;
            }
            const Vec3f l = coarse.log_scales[i];
            const float radius = 3 * std::exp(std::max({l.x, l.y, l.z}));
            if (std::ranges::any_of(cameras, [&](const Camera& camera) {
                    return may_be_visible(camera, coarse.means[i], radius);
                }))
                block.fixed.push_back(int(i));
        }
        block.expected = expected * double(inside.size()) / double(coarse.means.size());

        const PointCloud& all = scene.points;
        for (std::size_t i = 0; i < all.positions.size(); ++i) {
            if (!belongs(cell, vec_cast<double>(all.positions[i]))) continue;
            block.points.positions.push_back(all.positions[i]);
            if (!all.colors.empty()) block.points.colors.push_back(all.colors[i]);
            if (!all.normals.empty()) block.points.normals.push_back(all.normals[i]);
        }
        if (block.points.positions.size() >= kFewPoints) continue;
        // The scene has hardly any points here: use the surface of the coarse run.
        block.points = {};
        for (const int i : inside) {
            block.points.positions.push_back(coarse.means[i]);
            Vec3f color = coarse.sh[i];
            for (int c = 0; c < 3; ++c)
                color[c] = std::clamp(0.5f + float(kShC0) * color[c], 0.0f, 1.0f);
            block.points.colors.push_back(color);
        }
    }
    return blocks;
}

}  // namespace tvsgs
