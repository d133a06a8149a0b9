// What a splatting backbone offers: images of Gaussians, and the gradients back.
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

/// A set of maps to render. The buffers of what is not asked for may stay empty; reading them is an
/// error.
enum class Maps : unsigned {
    none = 0,
    color = 1,
    normal = 2,
    depth = 4,
    distortion = 8,
    expected_depth = 16,
    coverage = 32  // always there; asked for: derivatives by the transmittance
};

constexpr Maps operator|(Maps a, Maps b) {
    return static_cast<Maps>(static_cast<unsigned>(a) | static_cast<unsigned>(b));
}
constexpr Maps& operator|=(Maps& a, Maps b) {
    return a = a | b;
}
/// Whether any of `some` is in the set.
constexpr bool has(Maps set, Maps some) {
    return (static_cast<unsigned>(set) & static_cast<unsigned>(some)) != 0;
}

/// What is left of a set without `some`.
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

/// Where the rays of depth maps pass through the pixels. `official` keeps a habit of PGSR's code:
/// half a pixel up and left of the centres, through which it blends.
enum class PixelCenter { exact, official };

/// The camera whose pixel_ray() the depth of a view lies on.
inline Camera ray_camera(Camera camera, PixelCenter center) {
    if (center == PixelCenter::official) camera.cx_px += 0.5f, camera.cy_px += 0.5f;
    return camera;
}

/// Images of one render, pixel (x, y) at y * width + x.
template <class Device>
struct RenderedImages {
    int width = 0, height = 0;
    Camera camera;                // its pixel_ray() is what depth lies on; see ray_camera()
    Buffer<Vec3f, Device> color;  // [H W] not clamped
    Buffer<float, Device>
        transmittance;             // [H W] left behind all splats; coverage is 1 - transmittance
    Buffer<Vec3f, Device> normal;  // [H W] camera frame, blended; some rasterisers normalise it
    Buffer<float, Device> depth;   // [H W] z-depth of the surface; 0 where it is undefined
    Buffer<float, Device> distortion;  // [H W] how far apart in depth is what a pixel blends
    Buffer<float, Device>
        expected_depth;  // [H W] mean z-depth of what a pixel blends, by weight; 0: nothing
};

/// dL/d of the images, in their shapes. An empty buffer stands for zeros: no loss has written to
/// it. dL/d of a depth is ignored at pixels where it is undefined (0).
template <class Device>
struct ImageGradients {
    Buffer<Vec3f, Device> color, normal;
    Buffer<float, Device> depth, distortion, expected_depth, transmittance;
};

/// What densification wants to know of one render, per Gaussian. Zero where the Gaussian is not
/// visible.
template <class Device>
struct ScreenStatistics {
    Buffer<float, Device> radii_px;         // [N] 3-sigma radius, rounded up; > 0 means visible
    Buffer<Vec2f, Device> dL_dmeans2d;      // [N] per NDC unit, summed over pixels
    Buffer<Vec2f, Device> abs_dL_dmeans2d;  // [N] the same with absolute values per pixel
    Buffer<int, Device>
        front_pixels;  // [N] pixels where it was blended while T > 0.5 (PGSR's `observe`)
};

/// What the depth of a surface is, of the depths that a pixel blends: by the blended plane; their
/// mean by weight; or where half of the light is gone (of surfels: the last one that more than half
/// gets to). `automatic`: plane where the rasteriser has planes, else median.
enum class SurfaceDepth { automatic, plane, expected, median };

struct BackboneOptions {
    float near = 0.2f;
    PixelCenter pixel_center = PixelCenter::exact;
    SurfaceDepth depth = SurfaceDepth::automatic;

    template <class Visitor>
    void fields(Visitor& field) {
        field("near", near, {1e-6, 1e6},
              "splats nearer to the camera plane than this are not drawn, world units");
        field.choice("pixel_center", pixel_center, {"exact", "official"},
                     "rays of depth maps through the pixel centres, or half a pixel off as in "
                     "PGSR's code (for parity studies)");
        field.choice(
            "depth", depth, {"auto", "plane", "expected", "median"},
            "the surface's depth: of the blended plane, the mean of what a pixel blends, or "
            "where half of its light is gone; auto: plane where the rasteriser has planes, else "
            "median");
    }
};

/// What one render draws.
struct RenderCounts {
    int visible = 0;    // splats in some tile's list
    int fragments = 0;  // entries of all lists
};

/// The work of blending one render. On both devices a warp stands for 8x8 pixels, a quarter of a
/// tile; on CUDA each of its lanes has two of them.
struct BlendWork {
    std::int64_t tests = 0;          // of splats against the pixels of a warp
    std::int64_t hits = 0;           // splats that may draw in a warp
    std::int64_t evaluations = 0;    // alphas at pixels that are not full yet
    std::int64_t contributions = 0;  // evaluations that draw
    std::int64_t draws = 0;          // hits that draw at some pixel; the other hits are wasted
    std::int64_t sums = 0;           // draws by several lanes, whose gradients have to be added up
};

struct FusedGradients;  // fused_gradients.h

template <class Device>
class Backbone {
public:
    virtual ~Backbone() = default;

    /// What forward() may be asked for.
    virtual Maps maps() const { return Maps::color | kGeometryMaps; }

    /// Whether splats are discs: their third scale, along the normal, is not theirs to choose.
    virtual bool flat() const { return false; }

    /// What is added to the covariances of ellipses in the image, px^2; viewers draw by it.
    virtual float low_pass_px2() const { return 0; }

    /// Whether splats thinner than a pixel are drawn fainter, so that nothing should flatten them.
    virtual bool fades_thin_splats() const { return false; }

    /// Called before the first step of a training (`step` is 0) and after each. Updates what the
    /// rasteriser keeps beside the parameters (Gaussians::filter). `changed`: the step added,
    /// removed or re-ordered splats; the filter's entries were re-ordered with them. `cameras`: of
    /// the training views. What this writes to `gaussians` is saved with them; any other state that
    /// is kept from step to step would be lost on resuming.
    virtual void prepare(int /*step*/,
                         bool /*changed*/,
                         const std::vector<Camera>& /*cameras*/,
                         Gaussians<Device>& /*gaussians*/) {}

    /// Renders; the result stays valid until the next call. `sh_degree` is the degree in use, at
    /// most the stored one.
    virtual const RenderedImages<Device>& forward(const Gaussians<Device>& gaussians,
                                                  const Camera& camera,
                                                  int sh_degree,
                                                  Maps maps) = 0;

    /// Gradients of the last forward(), added to `dL_dgaussians`, which has the shape already; its
    /// harmonics may be missing where no colour was rendered, and get gradients of splats in view
    /// alone, those with a radius. Writes statistics().
    virtual void backward(const Gaussians<Device>& gaussians,
                          const ImageGradients<Device>& dL_dimages,
                          Gaussians<Device>& dL_dgaussians) = 0;

    /// Whether blend_backward() is implemented. Adam's step then needs no gradients of parameters
    /// in memory.
    virtual bool fuses() const { return false; }

    /// The first half of backward(): what the splats add up over pixels. The second half, a
    /// SplatVjp, carries it to the parameters and writes statistics(); Adam's step calls it where
    /// it uses the gradients. Valid until the next call of any method; null unless fuses().
    virtual const FusedGradients* blend_backward(const Gaussians<Device>& /*gaussians*/,
                                                 const ImageGradients<Device>& /*dL_dimages*/) {
        return nullptr;
    }

    /// Whether add_camera_gradient() is implemented.
    virtual bool moves_cameras() const { return false; }

    /// Adds dL/d of the camera of the last forward() to `sum`, the kCameraNumbers numbers of a
    /// CameraGradient, on the device. Overwrites what a backward() leaves, which is to be called
    /// after it.
    virtual void add_camera_gradient(const Gaussians<Device>& /*gaussians*/,
                                     const ImageGradients<Device>& /*dL_dimages*/,
                                     Span<double> /*sum*/) {}

    /// Writes the statistics() that a backward() of zeros would write after the last forward().
    virtual void observe(const Gaussians<Device>& gaussians) {
        Gaussians<Device> unused;
        resize(unused, gaussians.size(), gaussians.sh_degree);
        fill_zero(unused);
        backward(gaussians, {}, unused);
    }

    /// Of the last forward() (radii) and backward() (the rest).
    virtual const ScreenStatistics<Device>& statistics() const = 0;

    /// Of the last forward().
    virtual RenderCounts counts() const { return {}; }

    /// Counts the work of blending in the last forward(); takes about as long as the blending did.
    virtual BlendWork blend_work() const { return {}; }

    /// For measurements: from now on sums over fragments are made as FragmentGradients::atomic
    /// says.
    virtual void use_atomic_sums() {}

    /// Times of the parts of forward() and backward(); off unless switched on.
    StageClock<Device>& clock() { return clock_; }

private:
    StageClock<Device> clock_;
};

/// In the place of the second half of backward(): the statistics() that it writes.
template <class Device>
void write_statistics(Device device, const FusedGradients& gradients);

/// Adds a backbone of a program that links this library: make_backbone() then knows its name. To be
/// called before any training starts. The library's own are in backbones_list.h.
template <class Device>
using MakeBackbone = std::function<std::unique_ptr<Backbone<Device>>(const BackboneOptions&)>;
template <class Device>
void add_backbone(const std::string& name, MakeBackbone<Device> make);

/// Throws Error(ExitCode::usage) naming the known ones when `name` is not among them.
template <class Device>
std::unique_ptr<Backbone<Device>> make_backbone(const std::string& name,
                                                const BackboneOptions& options);

/// Names of ours that draw discs (`flat`), or ellipsoids: "a, b".
std::string backbones_of(bool flat);

}  // namespace tvsgs
