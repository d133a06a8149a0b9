// Tests tile lists and blending with artificial ellipses, including extreme ones: the lists against
// the definition, CUDA against the CPU.
#include <algorithm>
#include <array>
#include <cstring>

#include "render/ewa/blend_ewa.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

constexpr Channels kAll = Channels::color_plane;
using Model = EwaModel<kAll>;

/// Kinds of ellipses.
enum class Kind { specks, mixed, needles, huge, opaque, stack };
constexpr Kind kKinds[] = {Kind::specks, Kind::mixed,  Kind::needles,
                           Kind::huge,   Kind::opaque, Kind::stack};
const char* const kNames[] = {"specks", "mixed", "needles", "huge", "opaque", "stack"};

/// Projected splats; one in ten has the depth of its predecessor.
EwaSplats<Cpu> made_up(Kind kind, int count, const TileGrid& grid, unsigned seed) {
    test::Random random(seed);
    EwaSplats<Cpu> v;
    v.resize(static_cast<std::size_t>(count));
    const double width = grid.width, height = grid.height;
    for (std::size_t i = 0; i < v.shapes.size(); ++i) {
        double a = std::exp(random.uniform(-0.6, 1.2)), b = std::exp(random.uniform(-0.6, 1.2));
        if (kind == Kind::mixed) a *= std::exp(random.uniform(0, 3));
        if (kind == Kind::needles) a = std::exp(random.uniform(3, 7)), b = 0.6;
        if (kind == Kind::huge) a *= width, b *= height;
        const double turn = random.uniform(0, 3.14159), c = std::cos(turn), s = std::sin(turn);
        const Sym2<double> C{a * a * c * c + b * b * s * s, (a * a - b * b) * c * s,
                             a * a * s * s + b * b * c * c};
        const auto root = ellipse_root(C, a * a * b * b);
        SplatShape<float>& shape = v.shapes[i];
        shape.mean = {float(random.uniform(-0.2, 1.2) * width),
                      float(random.uniform(-0.2, 1.2) * height)};
        if (kind == Kind::stack) shape.mean = {float(width / 2), float(height / 2)};
        shape.root = {float(root.xx), float(root.xy), float(root.yy)};
        shape.opacity = float(kind == Kind::opaque  ? random.uniform(0.98, 0.99999)
                              : kind == Kind::stack ? random.uniform(0.0039, 0.006)
                                                    : random.uniform(0.0035, 0.9));
        shape.reach = splat_reach(shape.opacity);
        v.features[i].f = {vec_cast<float>(random.normal3()), vec_cast<float>(random.normal3()),
                           float(random.uniform(1, 3))};
        v.depths[i] =
            i > 0 && random.uniform(0, 1) < 0.1 ? v.depths[i - 1] : float(random.uniform(0.5, 9));
        v.rects[i] = shape.opacity > kMinAlpha ? tile_rect(shape.mean, splat_extent(shape), grid)
                                               : TileRect{};
    }
    return v;
}

/// The splats of each tile in order.
template <class Device>
std::vector<std::vector<std::uint32_t>> splats_by_tile(const TileLists<Device>& lists) {
    const auto splats = to_host(lists.splats);
    std::vector<std::vector<std::uint32_t>> tiles;
    for (const TileSpan span : to_host(lists.spans))
        tiles.emplace_back(splats.begin() + span.begin, splats.begin() + span.end);
    return tiles;
}

/// Fragments are contiguous per splat, and the sorted fragments name their splats.
template <class Device>
void expect_consistent(const TileLists<Device>& lists) {
    const auto counts = to_host(lists.fragment_counts), first = to_host(lists.first_fragment);
    const auto fragments = to_host(lists.fragments), splats = to_host(lists.splats);
    ASSERT_EQ(fragments.size(), static_cast<std::size_t>(lists.fragment_count));
    std::uint64_t total = 0;
    int visible = 0;
    for (std::uint32_t count : counts) total += count, visible += count > 0;
    EXPECT_EQ(total, fragments.size());
    EXPECT_EQ(visible, lists.visible_count);
    std::vector<char> met(fragments.size());
    for (std::size_t at = 0; at < fragments.size(); ++at) {
        const std::uint32_t fragment = fragments[at], splat = splats[at];
        ASSERT_LT(fragment, fragments.size());
        EXPECT_EQ(met[fragment]++, 0);
        EXPECT_GE(fragment, first[splat]);
        EXPECT_LT(fragment, first[splat] + counts[splat]);
    }
}

TEST(TileLists, HoldWhatDrawsFrontToBack) {
    const TileGrid grid = tile_grid(75, 41);
    for (const Kind kind : kKinds) {
        SCOPED_TRACE(kNames[static_cast<int>(kind)]);
        const auto v = made_up(kind, 400, grid, 21);
        TileLists<Cpu> lists;
        build_tile_lists(v, grid, lists);
        expect_consistent(lists);
        const auto tiles = splats_by_tile(lists);
        ASSERT_EQ(tiles.size(), static_cast<std::size_t>(grid.count()));
        for (std::size_t t = 0; t < tiles.size(); ++t) {
            for (std::size_t k = 1; k < tiles[t].size(); ++k) {
                const std::uint32_t before = tiles[t][k - 1], splat = tiles[t][k];
                EXPECT_TRUE(v.depths[before] < v.depths[splat] ||
                            (v.depths[before] == v.depths[splat] && before < splat));
            }
            const int left = static_cast<int>(t) % grid.columns * kTileSize,
                      top = static_cast<int>(t) / grid.columns * kTileSize;
            for (std::uint32_t i = 0; i < v.shapes.size(); ++i) {
                if (v.rects[i].count() == 0) continue;
                bool draws = false;
                for (int y = top; y < std::min(top + kTileSize, grid.height); ++y)
                    for (int x = left; x < std::min(left + kTileSize, grid.width); ++x)
                        draws |= splat_alpha(v.shapes[i],
                                             {v.shapes[i].mean.x - (static_cast<float>(x) + 0.5f),
                                              v.shapes[i].mean.y - (static_cast<float>(y) + 0.5f)})
                                     .alpha > 0;
                if (draws) {
                    EXPECT_NE(std::find(tiles[t].begin(), tiles[t].end(), i), tiles[t].end());
                }
            }
        }
    }
}

template <class Device>
struct Blended {
    TileLists<Device> lists;
    std::vector<Vec3f> color, normal;
    std::vector<float> transmittance, distance;
    std::vector<SplatGradients<float>> splats;
};

/// Smooth gradients of the channels.
template <class Device>
struct ChannelGradients {
    Buffer<Vec3f, Device> color, normal;
    Buffer<float, Device> distance;

    PixelGradientReader<kAll> reader() const {
        return {color.span(), normal.span(), distance.span()};
    }
};
template <class Device>
ChannelGradients<Device> channel_gradients(std::size_t pixels) {
    std::vector<Vec3f> color, normal;
    std::vector<float> distance;
    for (std::size_t p = 0; p < pixels; ++p) {
        const float t = 0.01f * static_cast<float>(p);
        color.push_back({std::sin(t), std::cos(2 * t), 0.5f});
        normal.push_back({0.3f, std::sin(3 * t), std::cos(t)});
        distance.push_back(0.2f * std::cos(0.5f * t));
    }
    ChannelGradients<Device> g;
    copy(color, g.color), copy(normal, g.normal), copy(distance, g.distance);
    return g;
}

/// Images to be written, with room for all channels.
template <class Device>
RenderedImages<Device> empty_images(std::size_t pixels) {
    RenderedImages<Device> images;
    images.color.resize(pixels), images.normal.resize(pixels), images.transmittance.resize(pixels);
    images.depth.resize(pixels);
    return images;
}

Camera camera_of(const TileGrid& grid) {
    Camera camera;
    camera.width_px = grid.width, camera.height_px = grid.height;
    camera.fx_px = camera.fy_px = 100;
    return camera;
}

template <class Device>
void fetch(const RenderedImages<Device>& images,
           const Buffer<float, Device>& distance,
           const EwaFragmentGradients<Device>& fragments,
           Blended<Device>& out) {
    out.color = to_host(images.color), out.normal = to_host(images.normal);
    out.transmittance = to_host(images.transmittance), out.distance = to_host(distance);
    const auto gradients = to_host(fragments.gradients);
    const auto drawn = to_host(fragments.drawn);
    const auto counts = to_host(out.lists.fragment_counts),
               first = to_host(out.lists.first_fragment);
    for (std::size_t i = 0; i < counts.size(); ++i)
        out.splats.push_back(counts[i] > 0 && drawn[first[i]] ? gradients[first[i]]
                                                              : SplatGradients<float>{});
}

/// `width`: of the CPU's packs; CUDA has no such argument.
template <class Device, class... Width>
Blended<Device> blended(const EwaSplats<Cpu>& host, const TileGrid& grid, Width... width) {
    EwaSplats<Device> v;
    copy(host.shapes, v.shapes), copy(host.features, v.features);
    copy(host.depths, v.depths), copy(host.rects, v.rects);
    const auto pixels =
        static_cast<std::size_t>(grid.width) * static_cast<std::size_t>(grid.height);
    auto images = empty_images<Device>(pixels);
    Buffer<float, Device> distance;
    Buffer<std::uint32_t, Device> stops;
    distance.resize(pixels), stops.resize(pixels);
    EwaFragmentGradients<Device> fragments;
    Blended<Device> out;
    build_tile_lists(v, grid, out.lists);
    images.camera = camera_of(grid);
    blend_tiles<Model>(v, out.lists, grid, {images, distance}, stops, width...);
    const auto dL_dchannels = channel_gradients<Device>(pixels);
    blend_tiles_vjp<Model>(v, out.lists, grid, dL_dchannels.reader(), images.transmittance, stops,
                           fragments, width...);
    fetch(images, distance, fragments, out);
    return out;
}

/// Reference: pixel by pixel, every splat of the tile's list, with sums of gradients in double.
Blended<Cpu> blended_plainly(const EwaSplats<Cpu>& v, const TileGrid& grid) {
    const auto pixels =
        static_cast<std::size_t>(grid.width) * static_cast<std::size_t>(grid.height);
    auto images = empty_images<Cpu>(pixels);
    Buffer<float, Cpu> distance;
    distance.resize(pixels);
    const auto dL_dchannels = channel_gradients<Cpu>(pixels);
    images.camera = camera_of(grid);
    const PixelWriter<kAll> write(images, distance);
    const PixelGradientReader<kAll> read = dL_dchannels.reader();
    Blended<Cpu> out;
    build_tile_lists(v, grid, out.lists);
    constexpr std::size_t kCount = SplatGradients<float>::kCount;
    std::vector<std::array<double, kCount>> sums(v.shapes.size());
    for (int y = 0; y < grid.height; ++y)
        for (int x = 0; x < grid.width; ++x) {
            const TileSpan span =
                out.lists
                    .spans[static_cast<std::size_t>(y / kTileSize * grid.columns + x / kTileSize)];
            const auto offset = [&](std::uint32_t splat) -> Vec2f {
                return {v.shapes[splat].mean.x - (static_cast<float>(x) + 0.5f),
                        v.shapes[splat].mean.y - (static_cast<float>(y) + 0.5f)};
            };
            PixelForward<float> pixel;
            std::uint32_t stop = span.begin;
            for (std::uint32_t at = span.begin; at < span.end; ++at) {
                const std::uint32_t splat = out.lists.splats[at];
                const float alpha = splat_alpha(v.shapes[splat], offset(splat)).alpha;
                if (alpha == 0) continue;
                if (!blend<kAll>(pixel, alpha, v.features[splat].f)) break;
                stop = at + 1;
            }
            write(x, y, pixel);
            PixelBackward<float> back{pixel.T, read(y * grid.width + x)};
            for (std::uint32_t at = stop; at-- > span.begin;) {
                const std::uint32_t splat = out.lists.splats[at];
                const auto a = splat_alpha(v.shapes[splat], offset(splat));
                if (a.alpha == 0) continue;
                SplatGradients<float> g{};
                const EllipseRoot<float>& root = v.shapes[splat].root;
                blend_vjp<kAll>(back, root, v.features[splat].f, whitened(root, offset(splat)), a,
                                g);
                const float* values = &g.mean.x;
                for (std::size_t k = 0; k < kCount; ++k)
                    sums[splat][k] += static_cast<double>(values[k]);
            }
        }
    EwaFragmentGradients<Cpu> none;
    none.resize(static_cast<std::size_t>(out.lists.fragment_count));
    none.drawn.fill_zero();
    fetch(images, distance, none, out);
    for (std::size_t i = 0; i < sums.size(); ++i)
        for (std::size_t k = 0; k < kCount; ++k)
            (&out.splats[i].mean.x)[k] = static_cast<float>(sums[i][k]);
    return out;
}

/// sqrt(sum (a-b)^2 / sum a^2) over all floats, or over one of every `stride`.
template <class T>
double relative_l2(const std::vector<T>& a,
                   const std::vector<T>& b,
                   std::size_t first = 0,
                   std::size_t stride = 1) {
    const auto* x = reinterpret_cast<const float*>(a.data());
    const auto* y = reinterpret_cast<const float*>(b.data());
    double difference = 0, total = 1e-30;
    for (std::size_t i = first; i < a.size() * sizeof(T) / sizeof(float); i += stride) {
        difference += std::pow(static_cast<double>(x[i]) - static_cast<double>(y[i]), 2);
        total += std::pow(static_cast<double>(x[i]), 2);
    }
    return std::sqrt(difference / total);
}

template <class T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

template <class Device>
void expect_twins(Kind kind, int count, int width, int height) {
    SCOPED_TRACE(testing::Message() << kNames[static_cast<int>(kind)] << ", " << count
                                    << " splats, " << width << " x " << height);
    const TileGrid grid = tile_grid(width, height);
    const auto v = made_up(kind, count, grid, 31 + static_cast<unsigned>(count));
    const auto cpu = blended<Cpu>(v, grid);
    const auto cuda = blended<Device>(v, grid), again = blended<Device>(v, grid);
    expect_consistent(cuda.lists);
    // The culling test rounds once less on a GPU: a tile that an ellipse just touches may be listed
    // on one device only, but the other tiles keep their order.
    const auto a = splats_by_tile(cpu.lists), b = splats_by_tile(cuda.lists);
    std::size_t differ = 0;
    for (std::size_t t = 0; t < a.size(); ++t) {
        std::size_t i = 0, j = 0;
        while (i < a[t].size() || j < b[t].size()) {
            if (i < a[t].size() && j < b[t].size() && a[t][i] == b[t][j]) {
                ++i, ++j;
                continue;
            }
            ++differ;
            const bool only_a =
                j == b[t].size() ||
                (i < a[t].size() && std::find(b[t].begin(), b[t].end(), a[t][i]) == b[t].end());
            only_a ? ++i : ++j;
        }
    }
    EXPECT_LE(differ, 1 + static_cast<std::size_t>(cpu.lists.fragment_count) / 10000);

    // Exponentials differ by some units in the last place, so a splat at its cut-off may be drawn
    // at a pixel on one device only (by 1/255 of its colour): 1e-4 of the whole. Gradients divide
    // by transmittances, hence 2e-3.
    const double images = 1e-4, gradients = 2e-3;
    EXPECT_LE(relative_l2(cpu.color, cuda.color), images);
    EXPECT_LE(relative_l2(cpu.normal, cuda.normal), images);
    EXPECT_LE(relative_l2(cpu.distance, cuda.distance), images);
    EXPECT_LE(relative_l2(cpu.transmittance, cuda.transmittance), images);
    constexpr std::size_t kCount = SplatGradients<float>::kCount;
    for (std::size_t k = 0; k < kCount; ++k)
        EXPECT_LE(relative_l2(cpu.splats, cuda.splats, k, kCount), gradients) << "value " << k;

    EXPECT_TRUE(same_bits(to_host(cuda.lists.fragments), to_host(again.lists.fragments)));
    EXPECT_TRUE(same_bits(cuda.color, again.color));
    EXPECT_TRUE(same_bits(cuda.splats, again.splats)) << "gradients are not reproducible";
}

TEST(Blend, PacksDoAsSinglePixelsDo) {
    for (const Kind kind : kKinds)
        for (const int count : {1, 33, 3000}) {
            SCOPED_TRACE(testing::Message() << kNames[static_cast<int>(kind)] << ", " << count);
            const TileGrid grid = tile_grid(75, 41);  // not a multiple of the tile size
            const auto v = made_up(kind, count, grid, 77 + static_cast<unsigned>(count));
            const auto plain = blended_plainly(v, grid), packs = blended<Cpu>(v, grid),
                       narrow = blended<Cpu>(v, grid, PackWidth::narrow);
            // Pixels do not mix: equal operations give equal bits.
            EXPECT_TRUE(same_bits(plain.color, packs.color));
            EXPECT_TRUE(same_bits(plain.normal, packs.normal));
            EXPECT_TRUE(same_bits(plain.distance, packs.distance));
            EXPECT_TRUE(same_bits(plain.transmittance, packs.transmittance));
            // Sums over pixels with terms of both signs round differently, but equally on all
            // processors.
            constexpr std::size_t kCount = SplatGradients<float>::kCount;
            for (std::size_t k = 0; k < kCount; ++k)
                EXPECT_LE(relative_l2(plain.splats, packs.splats, k, kCount), 3e-4) << k;
            EXPECT_TRUE(same_bits(narrow.color, packs.color));
            EXPECT_TRUE(same_bits(narrow.splats, packs.splats));
        }
}

TEST(BlendTwin, OnExtremeSplats) {
    if (const std::string reason = test::no_cuda(); !reason.empty()) GTEST_SKIP() << reason;
    if constexpr (kHasCuda) {
        for (const Kind kind : kKinds)
            for (const int count : {0, 1, 33, 5000}) expect_twins<Cuda>(kind, count, 203, 149);
        expect_twins<Cuda>(Kind::mixed, 5000, 16, 16);   // one tile
        expect_twins<Cuda>(Kind::huge, 2000, 640, 480);  // every splat in all of 1200 tiles

        const TileGrid wide = tile_grid(4100, 4130);  // tile indices beyond 16 bits
        const auto v = made_up(Kind::specks, 20000, wide, 7);
        EwaSplats<Cuda> on_device;
        copy(v.shapes, on_device.shapes), copy(v.depths, on_device.depths);
        copy(v.rects, on_device.rects);
        TileLists<Cpu> cpu;
        TileLists<Cuda> cuda;
        build_tile_lists(v, wide, cpu), build_tile_lists(on_device, wide, cuda);
        expect_consistent(cuda);
        const auto a = splats_by_tile(cpu), b = splats_by_tile(cuda);
        std::size_t differ = 0;
        for (std::size_t t = 0; t < a.size(); ++t) differ += a[t] != b[t];
        EXPECT_LE(differ, 3u) << "tiles that an ellipse just touches";
    }
}

TEST(Blend, StackOf5000KeepsItsGradients) {
    // Many faint splats: T falls over thousands of factors, and the backward pass divides by all of
    // them. The sum of the colour gradients is 1 - T for any splats.
    const TileGrid grid = tile_grid(16, 16);
    const auto v = made_up(Kind::stack, 5000, grid, 5);
    const auto out = blended<Cpu>(v, grid);
    const auto loss_gradients = channel_gradients<Cpu>(256);
    double expected = 0, sum = 0;
    for (std::size_t p = 0; p < 256; ++p)
        expected += static_cast<double>(loss_gradients.color[p].z) *
                    (1 - static_cast<double>(out.transmittance[p]));
    for (const auto& g : out.splats) sum += static_cast<double>(g.features.color.z);
    EXPECT_NEAR(sum, expected, 1e-3 * expected);  // 2,300 divisions, 1e-7 each
    EXPECT_LT(*std::min_element(out.transmittance.begin(), out.transmittance.end()), 1e-3);
}

}  // namespace
}  // namespace tvsgs
