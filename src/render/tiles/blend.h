// Compositing of all tiles, forward and backward, of whatever a model says its splats are.
#pragma once

#include <concepts>

#include "render/tiles/tiles.h"

namespace tvsgs {

/// The y of pixels that take no part, or of their offsets. It is so far away that alpha is 0 there,
/// which saves a flag, and small enough for products with it to stay finite.
inline constexpr float kOutOfReach = 1e25f;

/// What a rasteriser says of its splats: types and static functions, which blending inlines.
/// EwaModel is one. Compiled for both devices by a file each, see blend_cpu.h and blend_cuda.h.
///
///   Shape      what decides alpha, with may_draw(shape, low, high) as tiles.h asks for it
///   Features   what a splat adds to pixels; copy() takes over only those that the model blends:
///              the others are not written, and reading them is an error
///   Hit        a splat at a pixel: `alpha`, and what blending needs besides
///   offset()   of a pixel centre: what hit() goes by, such as where it is from the splat
///   hit()      forward and backward decide by it alike; alpha 0: the splat is skipped there
///   PixelForward, blend()       a pixel on the way to the back, from {}. False: it is full, and
///                               the splat was not blended. Alpha 0 changes nothing
///   PixelBackward, blend_vjp()  a pixel on the way back to the front, from {T, PixelGradient}, T
///                               the transmittance behind all splats; adds to the gradients of the
///                               splat. Of alpha 0 it adds zeros, and changes nothing but T
///   Gradients  kCount floats, their sums over pixels, in 16-byte words. Factors that are the
///              same at all pixels are left out; who takes the gradients multiplies by them
///   kFilled, filled(v)  how many of these the model fills, and which is the v-th
///   Writer     writes a finished pixel: write(x, y, pixel)
///   Reader     read(at) is the PixelGradient of pixel `at`; PixelGradient{} is zero. One that
///   knows
///              derivatives by the transmittance behind all splats has them as read.behind(at)
///
/// A model that also names ForwardPacks and BackwardPacks is blended several pixels at a time by
/// the CPU twin. One without blend() and what it needs is for the way back alone.
template <class Model>
concept BlendBackModel = requires(const typename Model::Shape& shape,
                                  const typename Model::Features& features,
                                  typename Model::Features& batch,
                                  const typename Model::Hit& hit,
                                  typename Model::PixelBackward& backward,
                                  typename Model::Gradients& gradients,
                                  const typename Model::Reader& read) {
    { Model::offset(shape, Vec2f{}) } -> std::same_as<Vec2f>;
    { Model::hit(shape, Vec2f{}) } -> std::same_as<typename Model::Hit>;
    { hit.alpha } -> std::convertible_to<float>;
    Model::blend_vjp(backward, shape, features, hit, gradients);
    { backward.T } -> std::convertible_to<float>;
    Model::copy(features, batch);
    { Model::filled(0) } -> std::same_as<int>;
    { read(0) } -> std::same_as<typename Model::PixelGradient>;
    {typename Model::PixelBackward{1.0f, read(0)}};
    requires Model::Gradients::kCount % 4 == 0 && alignof(typename Model::Gradients) == 16 &&
        sizeof(typename Model::Gradients) == Model::Gradients::kCount * sizeof(float);
};

template <class Model>
concept BlendModel = BlendBackModel<Model> && requires(const typename Model::Features& features,
                                                       const typename Model::Hit& hit,
                                                       typename Model::PixelForward& forward,
                                                       const typename Model::Writer& write) {
    { Model::blend(forward, hit, features) } -> std::same_as<bool>;
    write(0, 0, forward);
};

/// A pixel at the beginning of the way back. Whatever is behind all splats is seen by the
/// transmittance there, so a derivative by that is what blending finds behind the last splat.
template <class Model>
TVSGS_HD typename Model::PixelBackward pixel_backward(const typename Model::Reader& read,
                                                      int at,
                                                      float transmittance) {
    typename Model::PixelBackward pixel{transmittance, read(at)};
    if constexpr (requires { pixel.behind = read.behind(at); }) pixel.behind = read.behind(at);
    return pixel;
}

template <class Model, class Device>
using SplatsOf = ViewSplats<Device, typename Model::Shape, typename Model::Features>;

/// What blending reads of the view's splats; their records may lie in two places.
template <class Model, class Device>
struct BlendSplats {
    Span<const typename Model::Shape> shapes;
    Span<const typename Model::Features> features;

    BlendSplats(const SplatsOf<Model, Device>& splats)
        : BlendSplats(splats.shapes, splats.features) {}
    BlendSplats(const Buffer<typename Model::Shape, Device>& s,
                const Buffer<typename Model::Features, Device>& f)
        : shapes(s.span()), features(f.span()) {}
};

/// Gradients of the view's splats, each in the place of the splat's first fragment. The other
/// places are scratch: what each fragment adds. Only members that the model fills are defined.
template <class Device, class Gradients>
struct FragmentGradients {
    Buffer<Gradients, Device> gradients;
    Buffer<std::uint8_t, Device> drawn;  // 0: drew nothing, its gradient is not written
    // On a GPU: sums by floating-point atomics, so in another order each time. To measure what
    // reproducible bits cost; nothing else sets it.
    bool atomic = false;

    void resize(std::size_t fragments) { gradients.resize(fragments), drawn.resize(fragments); }
};

/// How many pixels the CPU twin computes at a time where the model has packs; the bits are the
/// same.
enum class PackWidth { narrow, widest };

/// Writes all pixels, and to `stops`, [H W], the place in the tile's list behind the last splat
/// blended.
template <BlendModel Model>
void blend_tiles(const BlendSplats<Model, Cpu>& splats,
                 const TileLists<Cpu>& lists,
                 const TileGrid& grid,
                 const typename Model::Writer& write,
                 Buffer<std::uint32_t, Cpu>& stops,
                 PackWidth width = PackWidth::widest);
template <BlendModel Model>
void blend_tiles(const BlendSplats<Model, Cuda>& splats,
                 const TileLists<Cuda>& lists,
                 const TileGrid& grid,
                 const typename Model::Writer& write,
                 Buffer<std::uint32_t, Cuda>& stops);

/// dL/d of the pixels to one gradient per splat; `fragments` is resized and overwritten. No
/// floating-point atomics: bit-identical from run to run.
template <BlendBackModel Model>
void blend_tiles_vjp(const BlendSplats<Model, Cpu>& splats,
                     const TileLists<Cpu>& lists,
                     const TileGrid& grid,
                     const typename Model::Reader& read,
                     const Buffer<float, Cpu>& transmittance,
                     const Buffer<std::uint32_t, Cpu>& stops,
                     FragmentGradients<Cpu, typename Model::Gradients>& fragments,
                     PackWidth width = PackWidth::widest);
template <BlendBackModel Model>
void blend_tiles_vjp(const BlendSplats<Model, Cuda>& splats,
                     const TileLists<Cuda>& lists,
                     const TileGrid& grid,
                     const typename Model::Reader& read,
                     const Buffer<float, Cuda>& transmittance,
                     const Buffer<std::uint32_t, Cuda>& stops,
                     FragmentGradients<Cuda, typename Model::Gradients>& fragments);

}  // namespace tvsgs
