// Interface of the splatting backbones: render images of Gaussians and return gradients.
#pragma once

#include <functional>
#include <iterator>
#include <memory>
#include <string>
#include <vector>

#include "core/error.h"
#include "core/scene/camera.h"
#include "core/scene/gaussians.h"
#include "core/stage_clock.h"

namespace tvsgs {

/// A set of maps to render. Buffers of maps outside the set may stay empty and must not be read.
enum class Maps : unsigned {
    none = 0,
    color = 1,
    normal = 2,
    depth = 4,
    distortion = 8,
    expected_depth = 16,
    coverage = 32  // always rendered; if requested: derivatives by the transmittance
};

constexpr Maps operator|(Maps a, Maps b) {
    return static_cast<Maps>(static_cast<unsigned>(a) | static_cast<unsigned>(b));
}
constexpr Maps& operator|=(Maps& a, Maps b) {
    return a = a | b;
}
/// True if the set contains any of `some`.
constexpr bool has(Maps set, Maps some) {
    return (static_cast<unsigned>(set) & static_cast<unsigned>(some)) != 0;
}

constexpr Maps without(Maps set, Maps some) {
    return static_cast<Maps>(static_cast<unsigned>(set) & ~static_cast<unsigned>(some));
}

inline constexpr Maps kGeometryMaps = Maps::normal | Maps::depth;

/// "normal, depth".
inline std::string names_of(Maps maps) {
    constexpr const char* kNames[] = {"color",      "normal",         "depth",
                                      "distortion", "expected_depth", "coverage"};
    std::string names;
    for (unsigned i = 0; i < std::size(kNames); ++i)
        if (has(maps, static_cast<Maps>(1u << i)))
            names += (names.empty() ? "" : ", ") + std::string(kNames[i]);
    return names;
}

/// Where the rays of depth maps pass through the pixels. `official` follows PGSR's code: half a
/// pixel up and left of the pixel centres that blending uses.
enum class PixelCenter { exact, official };

/// The camera whose pixel_ray() a view's depth map uses.
inline Camera ray_camera(Camera camera, PixelCenter center) {
    if (center == PixelCenter::official) camera.cx_px += 0.5f, camera.cy_px += 0.5f;
    return camera;
}

/// Images of one render; pixel (x, y) is at y * width + x.
template <class Device>
struct RenderedImages {
    int width = 0, height = 0;
    Camera camera;                        // its pixel_ray() carries the depth; see ray_camera()
    Buffer<Vec3f, Device> color;          // [H W] not clamped
    Buffer<float, Device> transmittance;  // [H W] behind all splats; coverage is 1 - transmittance
    Buffer<Vec3f, Device> normal;      // [H W] camera frame, blended; some backbones normalise it
    Buffer<float, Device> depth;       // [H W] z-depth of the surface; 0 if undefined
    Buffer<float, Device> distortion;  // [H W] spread in depth of the blended splats
    Buffer<float, Device>
        expected_depth;  // [H W] mean z-depth of the blended splats, by weight; 0: none
};

/// dL/d of the images, with their shapes. An empty buffer means zeros: no loss has written to it.
/// dL/d of a depth is ignored at pixels with undefined depth (0).
template <class Device>
struct ImageGradients {
    Buffer<Vec3f, Device> color, normal;
    Buffer<float, Device> depth, distortion, expected_depth, transmittance;
};

/// Statistics of one render for densification, per Gaussian. Zero if the Gaussian is not visible.
template <class Device>
struct ScreenStatistics {
    Buffer<float, Device> radii_px;         // [N] 3-sigma radius, rounded up; > 0 means visible
    Buffer<Vec2f, Device> dL_dmeans2d;      // [N] per NDC unit, summed over pixels
    Buffer<Vec2f, Device> abs_dL_dmeans2d;  // [N] the same with absolute values per pixel
    Buffer<int, Device>
        front_pixels;  // [N] pixels that blended it with T > 0.5 (`observe` in PGSR)
};

/// Definition of a pixel's surface depth. plane: depth of the blended plane; expected: mean depth
/// of the blended splats by weight; median: depth of the last splat that more than half of the
/// light reaches. automatic: plane if the backbone has planes, else median.
enum class SurfaceDepth { automatic, plane, expected, median };

struct BackboneOptions {
    float near = 0.2f;
    PixelCenter pixel_center = PixelCenter::exact;
    SurfaceDepth depth = SurfaceDepth::automatic;

    template <class Visitor>
    void fields(Visitor& field) {
        field("near", near, {1e-6, 1e6}, "smallest depth of a splat that is drawn, world units");
        field.choice("pixel_center", pixel_center, {"exact", "official"},
                     "rays of depth maps; exact: through pixel centres; official: half a pixel "
                     "off, as in PGSR's code");
        field.choice("depth", depth, {"auto", "plane", "expected", "median"},
                     "depth of the surface; plane: of the blended plane; expected: blended mean; "
                     "median: where transmittance falls to half; auto: plane if the rasteriser has "
                     "planes, else median");
    }
};

struct RenderCounts {
    int visible = 0;    // splats in at least one tile's list
    int fragments = 0;  // entries of all lists
};

/// Work of blending one render. On both devices a warp covers 8x8 pixels, a quarter of a tile; on
/// CUDA each lane has two pixels.
struct BlendWork {
    std::int64_t tests = 0;          // splats tested against the pixels of a warp
    std::int64_t hits = 0;           // splats that may draw in a warp
    std::int64_t evaluations = 0;    // alphas computed at pixels that are not full
    std::int64_t contributions = 0;  // evaluations that draw
    std::int64_t draws = 0;          // hits that draw at any pixel; the other hits are wasted
    std::int64_t sums = 0;           // draws by several lanes, whose gradients must be summed
};

struct BackboneTraits {
    Maps maps = Maps::color | kGeometryMaps;  // that forward() supports
    bool flat = false;               // splats are discs: training must not change their third scale
    bool fades_thin_splats = false;  // below a pixel, so that no loss should flatten splats
    float low_pass_px2 = 0;          // added to the covariances of ellipses; viewers need it
    bool fuses = false;              // implements blend_backward()
    bool has_camera_gradient = false;  // implements add_camera_gradient()
    bool parts_colors = false;         // obeys set_color_share()
};

struct FusedGradients;  // fused_gradients.h

/// A rasteriser of one device. The training calls forward(), then backward(), in turn.
template <class Device>
class Backbone {
public:
    const BackboneTraits traits;

    explicit Backbone(const BackboneTraits& of = {}) : traits(of) {}
    virtual ~Backbone() = default;

    /// Called before the first step of a training (`step` is 0) and after each step. Updates the
    /// data beside the parameters (Gaussians::filter). `changed`: the step added, removed or
    /// reordered splats; the filter was reordered with them. `cameras`: of the training views.
    /// Checkpoints save `gaussians`; a resumed run loses any other state kept between steps.
    virtual void prepare(int /*step*/,
                         bool /*changed*/,
                         const std::vector<Camera>& /*cameras*/,
                         Gaussians<Device>& /*gaussians*/) {}

    /// Sets the share of the derivatives by colour and transmittance that moves, turns and scales
    /// splats with an uncertainty; opacities and SH get all of them. statistics() get the share as
    /// well, so growth sees less of supported splats. Below 1 it needs traits.parts_colors.
    void set_color_share(float share) { color_share_ = share; }

    /// Renders. The result is valid until the next call. `sh_degree`: degree to use, at most the
    /// stored one.
    virtual const RenderedImages<Device>& forward(const Gaussians<Device>& gaussians,
                                                  const Camera& camera,
                                                  int sh_degree,
                                                  Maps maps) = 0;

    /// Adds the gradients of the last forward() to `dL_dgaussians`, which must have the shape of
    /// `gaussians`. Its SH coefficients may be missing if no colour was rendered; only splats in
    /// view (with a radius) get SH gradients. Writes statistics().
    virtual void backward(const Gaussians<Device>& gaussians,
                          const ImageGradients<Device>& dL_dimages,
                          Gaussians<Device>& dL_dgaussians) = 0;

    /// First half of backward(): sums over pixels for each splat. The second half, a SplatVjp,
    /// computes the gradients of the parameters and writes statistics(); Adam's step calls it, and
    /// then needs no gradients in memory. Valid until the next call of any method; null unless
    /// traits.fuses.
    virtual const FusedGradients* blend_backward(const Gaussians<Device>& /*gaussians*/,
                                                 const ImageGradients<Device>& /*dL_dimages*/) {
        return nullptr;
    }

    /// Adds dL/d of the camera of the last forward() to `sum`, the kCameraParameters numbers of a
    /// CameraGradient on the device. Overwrites results of backward(), so call backward() after it.
    virtual void add_camera_gradient(const Gaussians<Device>& /*gaussians*/,
                                     const ImageGradients<Device>& /*dL_dimages*/,
                                     Span<double> /*sum*/) {}

    /// Writes the statistics() of the last forward() as a backward() with zero gradients would.
    virtual void observe(const Gaussians<Device>& gaussians) {
        Gaussians<Device> unused;
        resize(unused, gaussians.size(), gaussians.sh_degree);
        fill_zero(unused);
        backward(gaussians, {}, unused);
    }

    /// Statistics of the last forward() (radii) and backward() (the rest).
    virtual const ScreenStatistics<Device>& statistics() const = 0;

    virtual RenderCounts counts() const { return {}; }

    /// Counts the work of blending in the last forward(). Takes about as long as the blending.
    virtual BlendWork blend_work() const { return {}; }

    /// Times of the parts of forward() and backward(), if switched on.
    StageClock<Device>& clock() { return clock_; }

protected:
    float color_share_ = 1;

private:
    StageClock<Device> clock_;
};

/// Replaces the second half of backward(): writes only the statistics().
template <class Device>
void write_statistics(Device device, const FusedGradients& gradients);

/// Adds a backbone of a program that links this library, so that make_backbone() knows its name.
/// Call it before any training starts. backbones_list.h has the library's own backbones.
template <class Device>
using MakeBackbone = std::function<std::unique_ptr<Backbone<Device>>(const BackboneOptions&)>;
template <class Device>
void add_backbone(const std::string& name, MakeBackbone<Device> make);

/// Throws Error(ExitCode::usage) with the known names if `name` is unknown.
template <class Device>
std::unique_ptr<Backbone<Device>> make_backbone(const std::string& name,
                                                const BackboneOptions& options);

/// Names of the library's backbones with discs (`flat`), or with ellipsoids: "a, b".
std::string backbones_of(bool flat);

}  // namespace tvsgs
