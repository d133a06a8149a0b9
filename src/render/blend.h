// Compositing of all tiles, forward and backward.
#pragma once

#include "render/backbone.h"
#include "render/tiles.h"

namespace tvsgs {

/// What the backward pass needs of the forward one.
template <class Device>
struct BlendState {
    Buffer<std::uint32_t, Device>
        stop;                        // [H W] place in the tile's list behind the last one blended
    Buffer<float, Device> distance;  // [H W] blended plane distances, world units
};

/// Gradients of the view's splats, each in the place of the splat's first slot, before complete().
/// The other places are scratch: what each slot adds. Only members that the channels fill are
/// defined.
template <class Device>
struct SlotGradients {
    Buffer<SplatGradients<float>, Device> gradients;
    Buffer<std::uint8_t, Device> drawn;  // 0: drew nothing, its gradient is not written
    // On a GPU: sums by floating-point atomics, so in another order each time. To measure what
    // reproducible bits cost; nothing else sets it.
    bool atomic = false;

    void resize(std::size_t slots) { gradients.resize(slots), drawn.resize(slots); }
};

/// How many pixels the CPU twin computes at a time; the bits are the same.
enum class PackWidth { narrow, widest };

/// Overwrites the images of the channel set, background black. Depth only with plane channels,
/// along the rays of `camera`.
template <Channels kChannels>
void blend_tiles(const ViewSplats<Cpu>& splats,
                 const TileLists<Cpu>& lists,
                 const TileGrid& grid,
                 const Camera& camera,
                 RenderedImages<Cpu>& images,
                 BlendState<Cpu>& state,
                 PackWidth width = PackWidth::widest);
template <Channels kChannels>
void blend_tiles(const ViewSplats<Cuda>& splats,
                 const TileLists<Cuda>& lists,
                 const TileGrid& grid,
                 const Camera& camera,
                 RenderedImages<Cuda>& images,
                 BlendState<Cuda>& state);

template <Channels kChannels>
struct PixelGradientReader;

/// dL/d of the channels to one gradient per splat; `slots` is resized and overwritten. No
/// floating-point atomics: bit-identical from run to run.
template <Channels kChannels>
void blend_tiles_vjp(const ViewSplats<Cpu>& splats,
                     const TileLists<Cpu>& lists,
                     const TileGrid& grid,
                     const RenderedImages<Cpu>& images,
                     const BlendState<Cpu>& state,
                     const PixelGradientReader<kChannels>& dL_dpixel,
                     SlotGradients<Cpu>& slots,
                     PackWidth width = PackWidth::widest);
template <Channels kChannels>
void blend_tiles_vjp(const ViewSplats<Cuda>& splats,
                     const TileLists<Cuda>& lists,
                     const TileGrid& grid,
                     const RenderedImages<Cuda>& images,
                     const BlendState<Cuda>& state,
                     const PixelGradientReader<kChannels>& dL_dpixel,
                     SlotGradients<Cuda>& slots);

/// Writes a finished pixel, shared by both devices.
template <Channels kChannels>
struct PixelWriter {
    Span<Vec3f> color, normal;
    Span<float> transmittance, distance, depth;
    Camera camera;

    PixelWriter(RenderedImages<Cpu>& i, BlendState<Cpu>& s, const Camera& c)
        : PixelWriter(i, s, c, 0) {}
    PixelWriter(RenderedImages<Cuda>& i, BlendState<Cuda>& s, const Camera& c)
        : PixelWriter(i, s, c, 0) {}

    TVSGS_HD void operator()(int x, int y, const PixelForward<float>& pixel) const {
        const int at = y * camera.width_px + x;
        transmittance[at] = pixel.T;
        if constexpr (has_color(kChannels)) color[at] = pixel.sum.color;
        if constexpr (has_plane(kChannels)) {
            normal[at] = pixel.sum.normal;
            distance[at] = pixel.sum.distance;
            depth[at] = plane_depth(pixel.sum.normal, pixel.sum.distance, pixel_ray(camera, x, y),
                                    1 - pixel.T);
        }
    }

private:
    template <class Images, class State>
    PixelWriter(Images& i, State& s, const Camera& c, int)
        : color(i.color.span()),
          normal(i.normal.span()),
          transmittance(i.transmittance.span()),
          distance(s.distance.span()),
          depth(i.depth.span()),
          camera(c) {}
};

/// Reads the gradients of a pixel's channels; missing ones are zero.
template <Channels kChannels>
struct PixelGradientReader {
    Span<const Vec3f> color, normal;
    Span<const float> distance;

    TVSGS_HD SplatFeatures<float> operator()(int at) const {
        SplatFeatures<float> g{};
        if constexpr (has_color(kChannels)) {
            if (!color.empty()) g.color = color[at];
        }
        if constexpr (has_plane(kChannels)) {
            if (!normal.empty()) g.normal = normal[at];
            if (!distance.empty()) g.distance = distance[at];
        }
        return g;
    }
};

}  // namespace tvsgs
