#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/error.h"
#include "core/math/sigmoid.h"
#include "core/scene/splat_lists.h"
#include "io/images/image_file.h"
#include "io/splats/splat_files.h"
#include "optim/growth/splat_order.h"
#include "pipeline/run/splat_selection.h"
#include "render/tiles/blend_math.h"
#include "report/page_data.h"

namespace tvsgs {
namespace {

const SplatFileOptions kFormat{.frame = SplatFrame::rdf};  // the page uses the frame of the cameras

void keep_largest(Gaussians<Cpu>& g, std::size_t count) {
    std::vector<int> order(g.means.size());
    std::iota(order.begin(), order.end(), 0);
    if (count >= order.size()) return;
    const std::vector<double> sizes = size_of_splats(g);
    std::nth_element(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count), order.end(),
                     [&](int a, int b) {
                         const double of_a = sizes[static_cast<std::size_t>(a)],
                                      of_b = sizes[static_cast<std::size_t>(b)];
                         return of_a != of_b ? of_a > of_b : a < b;
                     });
    order.resize(count);
    std::ranges::sort(order);
    keep_splats(order, g);
}

void lower_degree(Gaussians<Cpu>& g) {
    --g.sh_degree;  // coefficient major: the first planes stay
    g.sh.resize(g.means.size() * static_cast<std::size_t>(sh_count(g.sh_degree)));
}

constexpr int kRuns = 20, kRun = 250;  // runs of neighbouring splats, as a sample

/// Bytes per packed splat, estimated from runs of neighbours.
double bytes_per_splat(const Gaussians<Cpu>& g) {
    std::vector<int> some;
    for (int run = 0; run < kRuns; ++run)
        for (int k = 0; k < kRun; ++k)
            some.push_back(static_cast<int>(std::int64_t{run} * g.size() / kRuns) + k);
    return static_cast<double>(spz_bytes(splats_at(some, g), kFormat, "the page's splats").size()) /
           (kRuns * kRun);
}

/// Drops most splats that cannot fit, to avoid packing millions of splats repeatedly.
void drop_excess(Gaussians<Cpu>& g, std::size_t max_bytes) {
    constexpr double kFar = 1.25;  // packing may be this much better than the estimate
    if (g.size() < kRuns * kRun) return;
    const double most = kFar * static_cast<double>(max_bytes);
    double bytes = 0;
    while ((bytes = bytes_per_splat(g)) * g.size() > most && g.sh_degree > 0) lower_degree(g);
    if (bytes * g.size() > most) keep_largest(g, static_cast<std::size_t>(most / bytes));
}

}  // namespace

PackedSplats pack_splats(Gaussians<Cpu> g, std::size_t max_bytes, int max_splats) {
    std::vector<int> drawn;
    for (int i = 0; i < g.size(); ++i)
        if (sigmoid(g.opacity_logits[static_cast<std::size_t>(i)]) > kMinAlpha) drawn.push_back(i);
    keep_splats(drawn, g);
    PackedSplats packed;
    packed.of = g.size(), packed.of_degree = g.sh_degree;
    keep_largest(g, static_cast<std::size_t>(max_splats));
    sort_by_place(g);  // neighbours are similar, which compresses well
    drop_excess(g, max_bytes);
    while (g.size() > 0) {
        packed.bytes = spz_bytes(g, kFormat, "the page's splats");
        if (packed.bytes.size() <= max_bytes) break;
        if (g.sh_degree > 0) {
            lower_degree(g);
            continue;
        }
        const double share =
            0.97 * static_cast<double>(max_bytes) / static_cast<double>(packed.bytes.size());
        keep_largest(g, static_cast<std::size_t>(share * g.size()));
        packed.bytes.clear();
    }
    packed.shown = std::move(g);
    return packed;
}

std::string deflated(const std::string& bytes) {
    uLongf size = compressBound(static_cast<uLong>(bytes.size()));
    std::string out(size, '\0');
    const auto to = reinterpret_cast<Bytef*>(out.data());
    if (compress2(to, &size, reinterpret_cast<const Bytef*>(bytes.data()),
                  static_cast<uLong>(bytes.size()), 6) != Z_OK)
        throw Error(ExitCode::memory, "zlib: no memory to pack the page");
    out.resize(size);
    return out;
}

void split_at_charts(TriangleMesh& mesh, const EncodedTexture& texture) {
    std::vector<Vec3f> vertices(texture.places.size());
    for (std::size_t f = 0; f < mesh.faces.size(); ++f)
        for (int c = 0; c < 3; ++c) vertices[texture.faces[f][c]] = mesh.vertices[mesh.faces[f][c]];
    mesh = {std::move(vertices), {}, texture.faces};
}

std::string texture_for_page(const std::string& image, std::size_t max_bytes) {
    std::string jpeg = image;
    const bool is_jpeg = jpeg.starts_with("\xff\xd8");
    if (is_jpeg && jpeg.size() <= max_bytes) return jpeg;
    const ImageU8 whole = decode_image("the mesh's texture", image, 3);
    for (double scale = 1;; scale *= 0.8) {
        const auto scaled = [&](int n) { return std::max(1, static_cast<int>(scale * n)); };
        jpeg = jpeg_bytes(resize_bicubic(whole, scaled(whole.width), scaled(whole.height)), 85);
        if (jpeg.size() <= max_bytes || scaled(whole.width) < 64) return jpeg;
    }
}

PackedMesh pack_mesh(const TriangleMesh& mesh,
                     const std::vector<std::uint8_t>& errors,
                     const std::vector<Vec2f>& places) {
    Vec3f low = mesh.vertices.front(), high = low;
    for (const Vec3f v : mesh.vertices)
        for (int a = 0; a < 3; ++a)
            low[a] = std::min(low[a], v[a]), high[a] = std::max(high[a], v[a]);
    std::string bytes;
    const auto put = [&](std::uint32_t value, int count) {
        for (int b = 0; b < count; ++b) bytes += static_cast<char>(value >> (8 * b) & 255);
    };
    for (const Vec3f v : mesh.vertices)
        for (int a = 0; a < 3; ++a)
            put(static_cast<std::uint32_t>(
                    high[a] > low[a] ? std::lround(65535 * (v[a] - low[a]) / (high[a] - low[a]))
                                     : 0),
                2);
    for (const Vec2f p : places)
        for (const float along : {p.x, p.y})
            put(static_cast<std::uint32_t>(
                    std::lround(65535 * (along > 0 ? std::min(along, 1.0f) : 0))),
                2);
    for (const Vec3f c : mesh.colors)
        for (int a = 0; a < 3; ++a)
            put(static_cast<std::uint32_t>(std::lround(255 * std::clamp(c[a], 0.0f, 1.0f))), 1);
    for (const std::uint8_t level : errors) put(level, 1);
    for (const Vec3i face : mesh.faces)
        for (int c = 0; c < 3; ++c) put(static_cast<std::uint32_t>(face[c]), 4);
    const auto list = [](Vec3f v) { return JsonValue(std::vector<double>{v.x, v.y, v.z}); };
    JsonValue about;
    about.add("vertices", mesh.vertices.size())
        .add("faces", mesh.faces.size())
        .add("low", list(low))
        .add("high", list(high))
        .add("places", places.empty() ? 0.0 : 1.0)
        .add("colors", mesh.colors.empty() ? 0.0 : 1.0)
        .add("errors", errors.empty() ? 0.0 : 1.0);
    return {std::move(about), deflated(bytes)};
}

std::vector<std::uint8_t> error_levels(Span<const Vec3f> points, const Truth& truth, double full) {
    std::vector<Vec3d> places;
    for (std::size_t i = 0; i < points.count; ++i) places.push_back(vec_cast<double>(points[i]));
    const std::vector<double> errors = truth.surface.to.distances(places);
    std::vector<std::uint8_t> levels(places.size(), kNoError);
    for (std::size_t i = 0; i < places.size(); ++i)
        if (contains(truth.crop, places[i] + truth.measure.origin) && full > 0)
            levels[i] = static_cast<std::uint8_t>(
                std::lround(kErrorLevels * std::min(errors[i] / full, 1.0)));
    return levels;
}

}  // namespace tvsgs
