// Blending of all tiles, forward and backward, for any model of splats.
#pragma once

#include <concepts>

#include "render/tiles/tiles.h"

namespace tvsgs {

/// Value of y, of a pixel centre or offset, that marks a pixel as not blended. It is so large that
/// alpha is 0 there, so no flag is needed, and so small that products with it stay finite.
inline constexpr float kOutOfReach = 1e25f;

/// A blending model: types and static functions of a rasteriser's splats, which blending inlines.
/// EwaModel is an example. One source file per device compiles it, see blend_cpu.h and
/// blend_cuda.h.
///
///   Shape      determines alpha; has may_draw(shape, low, high) as tiles.h requires
///   Features   contribution of a splat to pixels. copy() copies only the members that the model
///              blends: the others are not written and must not be read
///   Hit        a splat at a pixel: `alpha`, and other values that blending needs
///   offset()   argument of hit() for a pixel centre, such as its offset from the splat
///   hit()      used by forward and backward, so that they decide alike; alpha 0 skips the splat
///   PixelForward, blend()       state of a pixel in the forward pass, initially {}. Returns
///                               false if the pixel is full and the splat was not blended. Alpha 0
///                               changes nothing
///   PixelBackward, blend_vjp()  state of a pixel in the backward pass, initially
///                               {T, PixelGradient}; T is the transmittance behind all splats.
///                               blend_vjp() adds to the gradients of the splat. Alpha 0 adds zeros
///                               and changes nothing but T
///   Gradients  kCount floats in 16-byte words: sums over pixels. Factors that are equal at all
///              pixels are left out; the reader of the gradients multiplies by them
///   kFilled, filled(v)  number of these floats that the model fills, and index of the v-th
///   Writer     write(x, y, pixel) stores a finished pixel
///   Reader     read(at) returns the PixelGradient of pixel `at`; PixelGradient{} is zero. A reader
///              with derivatives by the transmittance behind all splats returns them from
///              read.behind(at)
///
/// If a model also has ForwardPacks and BackwardPacks, the CPU version blends several pixels at a
/// time.
template <class Model>
concept BlendModel = requires(const typename Model::Shape& shape,
                              const typename Model::Features& features,
                              typename Model::Features& batch,
                              const typename Model::Hit& hit,
                              typename Model::PixelForward& forward,
                              typename Model::PixelBackward& backward,
                              typename Model::Gradients& gradients,
                              const typename Model::Writer& write,
                              const typename Model::Reader& read) {
    { Model::offset(shape, Vec2f{}) } -> std::same_as<Vec2f>;
    { Model::hit(shape, Vec2f{}) } -> std::same_as<typename Model::Hit>;
    { hit.alpha } -> std::convertible_to<float>;
    { Model::blend(forward, hit, features) } -> std::same_as<bool>;
    write(0, 0, forward);
    Model::blend_vjp(backward, shape, features, hit, gradients);
    { backward.T } -> std::convertible_to<float>;
    Model::copy(features, batch);
    { Model::filled(0) } -> std::same_as<int>;
    { read(0) } -> std::same_as<typename Model::PixelGradient>;
    {typename Model::PixelBackward{1.0f, read(0)}};
    requires Model::Gradients::kCount % 4 == 0 && alignof(typename Model::Gradients) == 16 &&
        sizeof(typename Model::Gradients) == Model::Gradients::kCount * sizeof(float);
};

/// State of a pixel at the start of the backward pass. The transmittance behind all splats is the
/// weight of the background, so the derivative by it is the first value of `behind`.
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

/// Gradients of the view's splats, each stored at the splat's first fragment. The elements of its
/// other fragments are scratch for their contributions. Only members that the model fills are
/// defined.
template <class Device, class Gradients>
struct FragmentGradients {
    Buffer<Gradients, Device> gradients;
    Buffer<std::uint8_t, Device> drawn;  // 0: the splat drew nothing; no gradient is written

    void resize(std::size_t fragments) { gradients.resize(fragments), drawn.resize(fragments); }
};

/// Number of pixels that the CPU version computes at a time, for models with packs. All widths give
/// the same bits.
enum class PackWidth { narrow, widest };

/// Writes all pixels. `stops` [H, W] gets the position after the last blended splat in the tile's
/// list.
template <BlendModel Model>
void blend_tiles(const SplatsOf<Model, Cpu>& splats,
                 const TileLists<Cpu>& lists,
                 const TileGrid& grid,
                 const typename Model::Writer& write,
                 Buffer<std::uint32_t, Cpu>& stops,
                 PackWidth width = PackWidth::widest);
template <BlendModel Model>
void blend_tiles(const SplatsOf<Model, Cuda>& splats,
                 const TileLists<Cuda>& lists,
                 const TileGrid& grid,
                 const typename Model::Writer& write,
                 Buffer<std::uint32_t, Cuda>& stops);

/// Computes one gradient per splat from dL/d of the pixels. Resizes and overwrites `fragments`.
/// Uses no floating-point atomics: bit-identical from run to run.
template <BlendModel Model>
void blend_tiles_vjp(const SplatsOf<Model, Cpu>& splats,
                     const TileLists<Cpu>& lists,
                     const TileGrid& grid,
                     const typename Model::Reader& read,
                     const Buffer<float, Cpu>& transmittance,
                     const Buffer<std::uint32_t, Cpu>& stops,
                     FragmentGradients<Cpu, typename Model::Gradients>& fragments,
                     PackWidth width = PackWidth::widest);
template <BlendModel Model>
void blend_tiles_vjp(const SplatsOf<Model, Cuda>& splats,
                     const TileLists<Cuda>& lists,
                     const TileGrid& grid,
                     const typename Model::Reader& read,
                     const Buffer<float, Cuda>& transmittance,
                     const Buffer<std::uint32_t, Cuda>& stops,
                     FragmentGradients<Cuda, typename Model::Gradients>& fragments);

}  // namespace tvsgs
