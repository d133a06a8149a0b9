// Rows of the stability suite: projection, blending and their backward passes.
#pragma once

#include "render/photometric/ssim_math.h"
#include "render/tiles/blend_math.h"
#include "stability/row.h"

namespace tvsgs::stability {

inline constexpr double kLowPass = 0.3;  // px^2, the default
inline constexpr double kNear = 0.2;     // world units, the default

/// A pinhole of 2,000 x 1,600 px.
template <class Real>
TVSGS_HD Pinhole<Real> pinhole_of(Feed<Real>& in) {
    Pinhole<Real> camera;
    camera.camera_from_world.R = in.mat3();
    camera.camera_from_world.t = in.vec3();
    camera.fx = camera.fy = in.number();
    camera.cx = 1000, camera.cy = 800;
    camera.u_max = 1300 / camera.fx, camera.u_min = -camera.u_max;
    camera.v_max = 1040 / camera.fy, camera.v_min = -camera.v_max;
    return camera;
}

/// A camera at a random place `distance` from the world's origin, and a point at `depth` in view.
struct Sight {
    Mat3<double> R;
    Vec3d t, p_camera, p_world;
};
inline Sight make_sight(Case& make, double focal, double distance, double depth) {
    Sight s;
    s.R = make.rotation_matrix();
    s.t = distance * make.direction();
    const double u = make.uniform(-900, 900) / focal, v = make.uniform(-700, 700) / focal;
    s.p_camera = {depth * u, depth * v, depth};
    s.p_world = transpose_times(s.R, s.p_camera - s.t);
    make.put(s.R), make.put(s.t), make.put(focal), make.put(s.p_world);
    return s;
}
/// How far rounding moves a point in the camera's frame, in roundings.
inline double motion(const double* in) {
    Feed<double> feed{in};
    const auto camera = pinhole_of(feed);
    return norm(camera.camera_from_world.t) + 3 * norm(feed.vec3());
}

/// Centres in the image, px. What ProjectBody culls comes out as 0.
struct ProjectedCentre {
    static constexpr int kIn = 16, kOut = 2;

    template <class Real>
    TVSGS_HD static void evaluate(const Real* numbers, Real* out) {
        Feed<Real> in{numbers};
        const Pinhole<Real> camera = pinhole_of(in);
        const Vec3<Real> p = camera.camera_from_world * in.vec3();
        const bool drawn = p.z > Real(kNear);
        const Vec2<Real> centre = project_point(camera, p);
        out[0] = drawn ? centre.x : 0, out[1] = drawn ? centre.y : 0;
    }
    static double size(const double*, const double*) { return 1; }
    static double bound(const double* numbers, const double*) {
        Feed<double> in{numbers};
        const auto camera = pinhole_of(in);
        const Vec3d p = camera.camera_from_world * in.vec3();
        if (!(p.z > kNear)) return kRounding;
        // 4 roundings of a point of the camera's frame, seen from p.z, and 4 of the coordinate.
        return kRounding * (4 * 2 * camera.fx / p.z * motion(numbers) + 4 * 2000);
    }
};
struct CentreFocal : ProjectedCentre {
    static constexpr RowText text{"projection: centre, px", "focal length, px",
                                  "f / z x 8 roundings of the largest coordinate, + 4 of 2,000 px",
                                  ""};
    static constexpr double kFrom = 50, kTo = 1e5;
    static void fill(double stress, Case& make) { make_sight(make, stress, 4, 4); }
};
struct CentreDepth : ProjectedCentre {
    static constexpr RowText text{
        "projection: centre, px", "1 / depth",
        "f / z x 8 roundings of the largest coordinate, + 4 of 2,000 px",
        "culled unless z > near (0.2), which also holds behind the camera"};
    static constexpr double kFrom = 0.05, kTo = 1e7;
    static void fill(double stress, Case& make) {
        const bool behind = stress > 10 && make.uniform(0, 1) < 0.5;
        make_sight(make, 1000, 4, (behind ? -1 : 1) / stress);
    }
};
struct CentreScale : ProjectedCentre {
    static constexpr RowText text{"projection: centre, px", "size of the scene",
                                  "as above: the same number of pixels at any size",
                                  "culled unless z > near (0.2)"};
    static constexpr double kFrom = 1e-6, kTo = 1e6;
    static void fill(double stress, Case& make) { make_sight(make, 1000, 4 * stress, 4 * stress); }
};

/// The exponent of a splat's Gaussian at 2 standard deviations along and across its ellipse and
/// between them.
struct Ellipse {
    static constexpr int kIn = 29, kOut = 3;

    template <class Real>
    TVSGS_HD static ImageEllipse<Real> ellipse(Feed<Real>& in) {
        const Pinhole<Real> camera = pinhole_of(in);
        const Vec3<Real> p = camera.camera_from_world * in.vec3();
        const Mat3<Real> R = rotation(normalize(in.quat()));
        const Vec3<Real> s = in.vec3();
        return image_ellipse(projection_jacobian(camera, p), R, s, Real(kLowPass));
    }
    template <class Real>
    TVSGS_HD static void evaluate(const Real* numbers, Real* out) {
        Feed<Real> in{numbers};
        const EllipseRoot<Real> root = ellipse_root(ellipse(in));
        for (int k = 0; k < kOut; ++k) {
            const Vec2<Real> w = whitened(root, in.vec2());
            out[k] = dot(w, w);
        }
    }
    static double kappa(const double* numbers) {
        Feed<double> in{numbers};
        const ImageEllipse<double> e = ellipse(in);
        const double mid = 0.5 * (e.covariance.xx + e.covariance.yy);
        const double most = mid + std::sqrt(std::max(0.0, mid * mid - e.det));
        return most * most / e.det;
    }
    static double size(const double*, const double*) { return 1; }
    static double bound(const double* numbers, const double*) {
        return 40 * kRounding * std::sqrt(kappa(numbers));
    }
    /// `length_px`: of the longest axis in the image; the others are that much shorter.
    static void make(Case& make, double length_px, double ratio, double size) {
        double numbers[kIn];
        Case scratch(0, numbers);
        const Sight sight = make_sight(make, 1000, 4 * size, 4 * size);
        scratch.put(sight.R), scratch.put(sight.t), scratch.put(1000), scratch.put(sight.p_world);
        const Quat<double> quat = make.unit_quat();
        const double longest = length_px * 4 * size / 1000;
        const Vec3d s{longest / ratio, longest * std::pow(ratio, -make.uniform(0, 1)), longest};
        make.put(quat), make.put(s), scratch.put(quat), scratch.put(s);
        Feed<double> feed{numbers};
        const Sym2<double> C = ellipse(feed).covariance;
        const double angle = 0.5 * std::atan2(2 * C.xy, C.xx - C.yy);
        for (const double turn : {0.0, 0.5 * 3.14159265358979, make.uniform(0.2, 1.3)}) {
            const Vec2<double> d{std::cos(angle + turn), std::sin(angle + turn)};
            const double det = C.xx * C.yy - C.xy * C.xy;
            const double q = (C.yy * d.x * d.x - 2 * C.xy * d.x * d.y + C.xx * d.y * d.y) / det;
            make.put(std::sqrt(2 / q) * d);
        }
    }
};
constexpr const char* kRootBound =
    "40 roundings x the ratio of the ellipse's axes: the root of the covariance, never the "
    "difference of products";
struct EllipseRatio : Ellipse {
    static constexpr RowText text{"projection: ellipse's exponent", "ratio of the scales",
                                  kRootBound, "the low-pass of 0.3 px^2 bounds the ratio"};
    static constexpr double kFrom = 1, kTo = 1e6;
    static void fill(double stress, Case& make) { Ellipse::make(make, 100, stress, 1); }
};
struct EllipseLength : Ellipse {
    static constexpr RowText text{"projection: ellipse's exponent",
                                  "length of a needle in the image, px", kRootBound,
                                  "det > 0 and finite, else not drawn"};
    static constexpr double kFrom = 1, kTo = 1e5;
    static void fill(double stress, Case& make) { Ellipse::make(make, stress, 1e6, 1); }
};
struct EllipseSize : Ellipse {
    static constexpr RowText text{"projection: ellipse's exponent", "absolute scale", kRootBound,
                                  ""};
    static constexpr double kFrom = 1e-6, kTo = 1e6;
    static void fill(double stress, Case& make) { Ellipse::make(make, 30, 100, stress); }
};

/// What pixels around a needle say about its shape: the sums over 65 of them, carried back through
/// the ellipse and the projection to log scales, rotation and place.
template <int kPart>
struct EllipseBackward {
    static constexpr int kIn = 29, kOut = kPart == 1 ? 4 : 3;

    template <class Real>
    TVSGS_HD static void evaluate(const Real* numbers, Real* out) {
        Feed<Real> in{numbers};
        const Pinhole<Real> camera = pinhole_of(in);
        const Vec3<Real> p = camera.camera_from_world * in.vec3();
        const Quat<Real> quat = in.quat();
        const Mat3<Real> R = rotation(normalize(quat));
        const Vec3<Real> s = in.vec3();
        const Vec2<Real> along = in.vec2(), across = in.vec2();
        const ProjectionJacobian<Real> T = projection_jacobian(camera, p);
        SplatShape<Real> shape{};
        shape.root = ellipse_root(image_ellipse(T, R, s, Real(kLowPass)));
        shape.opacity = Real(0.5);
        SplatGradients<Real> g{};
        for (int k = -32; k <= 32; ++k) {
            const Real at = Real(k) / 32, side = k % 2 ? Real(0.5) : Real(-0.25);
            const Vec2<Real> d = at * along + side * across;
            PixelBackward<Real> pixel{Real(0.5), {}};
            pixel.dL_dpixel.color = {1, Real(0.25), Real(0.5)};
            SplatFeatures<Real> f{};
            f.color = {1, Real(0.5), Real(0.25)};
            blend_vjp<Channels::color>(pixel, shape.root, f, whitened(shape.root, d),
                                       splat_alpha(shape, d), g);
        }
        complete(g, shape);
        const EllipseGradients<Real> to = image_ellipse_vjp(T, R, s, shape.root, g.spread);
        if constexpr (kPart == 0) {
            out[0] = to.dL_dlog_s.x, out[1] = to.dL_dlog_s.y, out[2] = to.dL_dlog_s.z;
        } else if constexpr (kPart == 1) {
            const Quat<Real> q = rotation_vjp(quat, to.dL_dR);
            out[0] = q.w, out[1] = q.x, out[2] = q.y, out[3] = q.z;
        } else {
            const Vec3<Real> dL_dp = projection_vjp(camera, p, Vec2<Real>{}, to.dL_dT);
            out[0] = dL_dp.x, out[1] = dL_dp.y, out[2] = dL_dp.z;
        }
    }
    static double size(const double* numbers, const double* exact) {
        if constexpr (kPart == 0) return norm_of(exact, kOut);
        // Turning or moving a needle by 1 / (its length in the image): what changes the picture.
        // Relative to what the log scales' gradients are then.
        double log_scales[3];
        EllipseBackward<0>::evaluate(numbers, log_scales);
        const double length = std::sqrt(Ellipse::kappa(numbers));
        Feed<double> in{numbers};
        const auto camera = pinhole_of(in);
        const double depth = norm(camera.camera_from_world * in.vec3());
        return norm_of(log_scales, 3) * length / (kPart == 1 ? 1 : depth);
    }
    static double bound(const double* numbers, const double*) {
        return 40 * kRounding * std::sqrt(Ellipse::kappa(numbers));
    }
};
constexpr const char* kBackwardBound = "40 roundings x the ratio of the ellipse's axes";
struct BackwardLogScales : EllipseBackward<0> {
    static constexpr RowText text{"projection backward: log scales",
                                  "length of a needle in the image, px", kBackwardBound, ""};
    static constexpr double kFrom = 1, kTo = 1e4;
    static void fill(double stress, Case& make) { Ellipse::make(make, stress, 1e6, 1); }
};
struct BackwardRotation : EllipseBackward<1> {
    static constexpr RowText text{"projection backward: rotation",
                                  "length of a needle in the image, px", kBackwardBound, ""};
    static constexpr double kFrom = 1, kTo = 1e4;
    static void fill(double stress, Case& make) { Ellipse::make(make, stress, 1e6, 1); }
};
struct BackwardPlace : EllipseBackward<2> {
    static constexpr RowText text{"projection backward: centre, by the ellipse",
                                  "length of a needle in the image, px", kBackwardBound, ""};
    static constexpr double kFrom = 1, kTo = 1e4;
    static void fill(double stress, Case& make) { Ellipse::make(make, stress, 1e6, 1); }
};
struct BackwardSize : EllipseBackward<0> {
    static constexpr RowText text{"projection backward: log scales", "absolute scale",
                                  kBackwardBound, ""};
    static constexpr double kFrom = 1e-6, kTo = 1e6;
    static void fill(double stress, Case& make) { Ellipse::make(make, 30, 100, stress); }
};

/// Rotations from stored quaternions of any length, and the gradient times that length.
struct QuaternionNorm {
    static constexpr RowText text{"rotation of a quaternion, and its gradient", "1 / norm",
                                  "32 roundings", "norm below 1e-12: divided by 1e-12, gradient 0"};
    static constexpr int kIn = 14, kOut = 13;
    static constexpr double kFrom = 3e-6, kTo = 3e30;
    static void fill(double stress, Case& make) {
        const Quat<double> q = make.unit_quat();
        make.put(Quat<double>{q.w / stress, q.x / stress, q.y / stress, q.z / stress});
        make.put(make.rotation_matrix()), make.put(1 / stress);
    }
    template <class Real>
    TVSGS_HD static void evaluate(const Real* numbers, Real* out) {
        Feed<Real> in{numbers};
        const Quat<Real> stored = in.quat();
        const Mat3<Real> R = rotation(normalize(stored));
        for (int i = 0; i < 9; ++i) out[i] = R[i / 3][i % 3];
        const Quat<Real> g = rotation_vjp(stored, in.mat3());
        const Real length = in.number();
        out[9] = length * g.w, out[10] = length * g.x, out[11] = length * g.y,
        out[12] = length * g.z;
    }
    static double size(const double*, const double*) { return 1; }
    static double bound(const double*, const double*) { return 32 * kRounding; }
};

/// One pixel behind which equal splats stand one after the other, front to back and back again.
struct PixelStack {
    static constexpr int kIn = 3, kOut = 7;

    template <class Real>
    TVSGS_HD static SplatFeatures<Real> feature(int i) {
        SplatFeatures<Real> f{};
        f.color = {Real(i % 7) / 8, Real(i % 5) / 4, Real(i % 3) / 2};
        f.normal = {0, 0, -1};
        f.distance = 1 + Real(i % 16) / 64;
        return f;
    }
    /// T, colour, distance; gradients of the first splat's opacity and colour.
    template <class Real>
    TVSGS_HD static void evaluate(const Real* numbers, Real* out) {
        Feed<Real> in{numbers};
        const int count = static_cast<int>(in.number());
        SplatShape<Real> shape{};
        shape.root = {Real(0.3), Real(0.1), Real(0.2)};
        shape.opacity = in.number();
        const Vec2<Real> d{in.number(), Real(0.5)};
        const SplatAlpha<Real> alpha = splat_alpha(shape, d);
        PixelForward<Real> pixel;
        int end = 0;
        if (alpha.alpha > 0)
            while (end < count &&
                   blend<Channels::color_plane>(pixel, alpha.alpha, feature<Real>(end)))
                ++end;
        out[0] = pixel.T, out[1] = pixel.sum.color.x, out[2] = pixel.sum.color.y;
        out[3] = pixel.sum.color.z, out[4] = pixel.sum.distance;
        PixelBackward<Real> back{pixel.T, {{1, Real(-0.5), Real(0.25)}, {0, 0, Real(0.1)}, 1}};
        SplatGradients<Real> g{};
        for (int i = end - 1; i >= 0; --i) {
            g = {};
            blend_vjp<Channels::color_plane>(back, shape.root, feature<Real>(i),
                                             whitened(shape.root, d), alpha, g);
        }
        out[5] = shape.opacity * g.opacity, out[6] = g.features.color.x;
    }
    static double size(const double*, const double*) { return 1; }
    static double bound(const double* numbers, const double*) {
        // A splat rounds T and the sums by 2 each on the way, and the decay by 5, which all share:
        // n alpha / (1 - alpha) of the logarithm of T, at most ln 1e4. Splats that draw: until T
        // is 1e-4. Whether the last one still draws is decided within that error.
        const double count = numbers[0], alpha = std::min(numbers[1], double(kMaxAlpha));
        if (alpha < kMinAlpha) return kRounding;
        const double drawn = std::min(count, std::ceil(std::log(1e-4) / std::log1p(-alpha)));
        return kRounding * (8 + 3 * drawn + 10 * drawn * alpha) / (1 - alpha) +
               (drawn < count ? 2 * double(kMinTransmittance) : 0);
    }
};
struct StackDepth : PixelStack {
    static constexpr RowText text{
        "blending and its backward, one pixel", "splats behind it",
        "3 roundings per splat that draws, + 1e-4 where the pixel is full",
        "a pixel is full where T < 1e-4: ~900 splats of alpha 0.01"};
    static constexpr double kFrom = 1, kTo = 1e5;
    static void fill(double stress, Case& make) {
        make.put(std::floor(stress)), make.put(make.uniform(0.008, 0.012)), make.put(0.25);
    }
};
struct StackOpacity : PixelStack {
    static constexpr RowText text{"blending and its backward, one pixel", "opacity / (1 - opacity)",
                                  "3 roundings per splat, / (1 - alpha)",
                                  "alpha below 1/255 is not drawn, above 0.99 it is 0.99"};
    static constexpr double kFrom = 1e-6, kTo = 1e7;
    static void fill(double stress, Case& make) {
        make.put(3), make.put(stress / (1 + stress)), make.put(make.uniform(0, 0.1));
    }
};

/// Opacity from its logit, and the derivative, relative to either.
struct OpacityOfLogit {
    static constexpr RowText text{"opacity and its derivative, relative", "opacity / (1 - opacity)",
                                  "8 roundings: the derivative is e / (1 + e)^2, not o (1 - o)",
                                  ""};
    static constexpr int kIn = 3, kOut = 2;
    static constexpr double kFrom = 1e-6, kTo = 1e7;
    static void fill(double stress, Case& make) {
        const double logit = std::log(stress) + make.uniform(-0.1, 0.1);
        make.put(logit), make.put(1 + std::exp(-logit));
        make.put((1 + std::exp(-logit)) * (1 + std::exp(logit)));
    }
    template <class Real>
    TVSGS_HD static void evaluate(const Real* in, Real* out) {
        const Real opacity = sigmoid(in[0]);
        out[0] = in[1] * opacity, out[1] = in[2] * sigmoid_slope(in[0]);
    }
    static double size(const double*, const double*) { return 1; }
    static double bound(const double*, const double*) { return 8 * kRounding; }
};

/// SSIM of two images whose windows are nearly of one colour.
struct SsimContrast {
    static constexpr RowText text{"SSIM and its derivatives", "1 / contrast",
                                  "8 roundings of the moments, each worth 1/C2 = 1,111",
                                  "C1 and C2: one-colour images are equal"};
    static constexpr int kIn = 5, kOut = 4;
    static constexpr double kFrom = 2, kTo = 1e8;
    static void fill(double stress, Case& make) {
        double x = 0, y = 0, xx = 0, yy = 0, xy = 0;
        const double level = make.uniform(0.2, 1);
        for (int i = 0; i < 25; ++i) {
            const double a = level + make.uniform(-0.5, 0.5) / stress,
                         b = level + make.uniform(-0.5, 0.5) / stress;
            x += a / 25, y += b / 25, xx += a * a / 25, yy += b * b / 25, xy += a * b / 25;
        }
        make.put(x), make.put(y), make.put(xx), make.put(yy), make.put(xy);
    }
    template <class Real>
    TVSGS_HD static void evaluate(const Real* in, Real* out) {
        const SsimTerms<Real> s = ssim_terms(SsimMoments<Real>{in[0], in[1], in[2], in[3], in[4]});
        // Derivatives in the size of the value: by a change of C2.
        const Real unit = Real(9e-4);
        out[0] = s.ssim, out[1] = unit * s.dS_dx, out[2] = unit * s.dS_dxx,
        out[3] = unit * s.dS_dxy;
    }
    static double size(const double*, const double*) { return 1; }
    static double bound(const double*, const double*) { return 8 * kRounding * 1111; }
};

}  // namespace tvsgs::stability
