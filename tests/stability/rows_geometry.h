// Rows of the stability suite: plane depth, normals, homographies, fusion, places far from the
// origin.
#pragma once

#include "mesh/fuse/tsdf_math.h"
#include "optim/losses/multiview_math.h"
#include "render/depth/normal_math.h"
#include "stability/row.h"
#include "stability/rows_render.h"

namespace tvsgs::stability {

/// From a splat to the depth of its plane along the ray through its own centre, over that depth.
struct PlaneDepth {
    static constexpr int kIn = 14, kOut = 1;

    template <class Real>
    struct Parts {
        CameraPlane<Real> plane;
        Vec3<Real> ray;
        Real depth;
    };
    static void make(Case& make, double cosine, double depth) {
        // n . p / |p| = cosine; the camera's axes are those of the splat, so that its normal is
        // exact in float.
        const Vec3d p = depth * Vec3d{make.uniform(-0.4, 0.4), make.uniform(-0.3, 0.3), 1};
        const Vec3d side = normalize(cross(p, make.direction())), toward = normalize(p);
        const Vec3d n = std::sqrt(1 - cosine * cosine) * side - cosine * toward;
        const Vec3d a = normalize(cross(n, side)), b = cross(n, a);
        Mat3<double> R;
        for (int i = 0; i < 3; ++i) R[i][0] = a[i], R[i][1] = b[i], R[i][2] = n[i];
        make.put(R), make.put(p), make.put(make.uniform(0.5, 1));
    }
    template <class Real>
    TVSGS_HD static Parts<Real> parts(const Real* numbers) {
        Feed<Real> in{numbers};
        const Mat3<Real> R = in.mat3();
        const Vec3<Real> p = in.vec3();
        const Real coverage = in.number();
        const Mat3<Real> identity{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
        CameraPlane<Real> plane = camera_plane(identity, R, 2, p);
        // Blended with what covers the pixel.
        plane.normal = coverage * plane.normal, plane.distance = coverage * plane.distance;
        const Vec3<Real> ray{p.x / p.z, p.y / p.z, 1};
        return {plane, ray, plane_depth(plane.normal, plane.distance, ray, coverage)};
    }
    static double cosine(const double* numbers) {
        const auto p = parts(numbers);
        return -dot(p.plane.normal, p.ray) / norm(p.plane.normal) / norm(p.ray);
    }
};
struct DepthGrazing : PlaneDepth {
    static constexpr RowText text{"plane depth, relative", "1 / cosine of the angle of view",
                                  "16 roundings / cosine",
                                  "cosine below 1e-3: no depth, no loss, not fused"};
    static constexpr double kFrom = 1, kTo = 1e6;
    static void fill(double stress, Case& make) { PlaneDepth::make(make, 1 / stress, 4); }
    template <class Real>
    TVSGS_HD static void evaluate(const Real* numbers, Real* out) {
        out[0] = parts(numbers).depth;
    }
    static double size(const double* in, const double*) { return in[11]; }
    static double bound(const double* in, const double*) {
        return 16 * kRounding / std::max(cosine(in), 1e-3);
    }
};
struct DepthDistance : DepthGrazing {
    static constexpr RowText text{"plane depth, relative", "depth", "16 roundings / cosine", ""};
    static constexpr double kFrom = 1e-6, kTo = 1e6;
    static void fill(double stress, Case& make) { PlaneDepth::make(make, 0.7, stress); }
};
/// Derivatives by the plane, relative to the largest.
struct DepthGradient : PlaneDepth {
    static constexpr RowText text{"plane depth, derivatives, relative",
                                  "1 / cosine of the angle of view", "32 roundings / cosine",
                                  "cosine below 1e-3: no depth, so no derivative"};
    static constexpr int kOut = 4;
    static constexpr double kFrom = 1, kTo = 1e6;
    static void fill(double stress, Case& make) { PlaneDepth::make(make, 1 / stress, 4); }
    template <class Real>
    TVSGS_HD static void evaluate(const Real* numbers, Real* out) {
        const Parts<Real> p = parts(numbers);
        PlaneDepthGradients<Real> g{};
        if (p.depth > 0) g = plane_depth_vjp(p.plane.normal, p.plane.distance, p.ray, Real(1));
        out[0] = g.dL_dnormal.x, out[1] = g.dL_dnormal.y, out[2] = g.dL_dnormal.z;
        out[3] = g.dL_ddistance;
    }
    static double size(const double*, const double* exact) { return norm_of(exact, kOut); }
    static double bound(const double* in, const double*) {
        return 32 * kRounding / std::max(cosine(in), 1e-3);
    }
};

/// Normals from four depths. Neighbouring points lie 2 z / f apart.
struct NormalFocal {
    static constexpr RowText text{
        "normal from depths", "focal length, px",
        "2 roundings of a point / their distance 2 z / f: depths in float hold no more", ""};
    static constexpr int kIn = 7, kOut = 3;
    static constexpr double kFrom = 50, kTo = 1e5;
    static void fill(double stress, Case& make) {
        const double slope = make.uniform(-1, 1), x = make.uniform(-0.3, 0.3);
        make.put(stress), make.put(x), make.put(make.uniform(-0.3, 0.3));
        // Left, right, up, down on the plane z = 4 + slope X.
        for (const double dx : {-1.0, 1.0, 0.0, 0.0}) make.put(4 / (1 - slope * (x + dx / stress)));
    }
    template <class Real>
    TVSGS_HD static void evaluate(const Real* in, Real* out) {
        const auto point = [&](int dx, int dy, Real depth) {
            const Real f = in[0], x = f * in[1] + Real(dx), y = f * in[2] + Real(dy);
            return depth * Vec3<Real>{x / f, y / f, 1};
        };
        const Vec3<Real> n = depth_normal(point(-1, 0, in[3]), point(1, 0, in[4]),
                                          point(0, -1, in[5]), point(0, 1, in[6]))
                                 .normal;
        out[0] = n.x, out[1] = n.y, out[2] = n.z;
    }
    static double size(const double*, const double*) { return 1; }
    static double bound(const double* in, const double*) { return kRounding * (4 + in[0]); }
};

/// A pixel carried to another view and back, px.
struct Reprojected {
    static constexpr int kIn = 18, kOut = 1;

    static void make(Case& make, double focal, double depth, double cosine) {
        // The other view looks at the same point from `cosine` off the surface.
        const double angle = make.uniform(0.1, 0.4), base = depth * angle;
        const Mat3<double> R = rotation(normalize(Quat<double>{1, 0, -angle / 2, 0}));
        const Vec3d p{0, 0, depth};
        const Vec3d there{depth * make.uniform(-50, 50) / focal, base * 0.01, depth};
        make.put(R), make.put(there - R * p), make.put(focal);
        make.put(depth), make.put(make.uniform(-0.3, 0.3) / focal), make.put(cosine);
        make.put(make.uniform(-100, 100) / focal), make.put(make.uniform(-100, 100) / focal);
    }
    template <class Real>
    TVSGS_HD static ViewPair<Real> pair(Feed<Real>& in) {
        ViewPair<Real> pair{};
        pair.other_from_reference.R = in.mat3();
        pair.other_from_reference.t = in.vec3();
        const Real focal = in.number();
        pair.reference = pair.other = {focal, focal, 1000, 800, 2000, 1600};
        return pair;
    }
    template <class Real>
    TVSGS_HD static void evaluate(const Real* numbers, Real* out) {
        Feed<Real> in{numbers};
        const ViewPair<Real> views = pair(in);
        const Real depth = in.number(), slope = in.number();
        in.number();
        const Vec3<Real> ray{in.number(), in.number(), 1};
        // The other view's depths: near to the true one, with a slope across its image.
        const Real there = (views.other_from_reference * (depth * ray)).z;
        const auto other_depth = [&](int pixel) {
            return there * (1 + slope * Real(pixel % 2000 - 1000) / 1000);
        };
        const Reprojection<Real> r = reproject(views, ray, depth, other_depth);
        out[0] = r.valid ? r.distance : 0;
    }
    static double size(const double*, const double*) { return 1; }
    static double bound(const double* numbers, const double*) {
        Feed<double> in{numbers};
        const auto views = pair(in);
        const double z = in.number(), f = views.reference.fx;
        // Two motions and two projections, each rounding points of about depth + baseline.
        return kRounding * (8 * f * (z + norm(views.other_from_reference.t)) / z + 4 * 2000);
    }
};
struct ReprojectedFocal : Reprojected {
    static constexpr RowText text{"homography: there and back, px", "focal length, px",
                                  "f x 8 roundings of (depth + baseline) / depth, + 4 of 2,000 px",
                                  ""};
    static constexpr double kFrom = 50, kTo = 1e5;
    static void fill(double stress, Case& make) { Reprojected::make(make, stress, 4, 1); }
};
struct ReprojectedScale : Reprojected {
    static constexpr RowText text{"homography: there and back, px", "size of the scene",
                                  "as above: the same number of pixels at any size",
                                  "nearer than multi_view.min_depth nothing is compared"};
    static constexpr double kFrom = 1e-6, kTo = 1e6;
    static void fill(double stress, Case& make) { Reprojected::make(make, 1000, 4 * stress, 1); }
};

/// 1 - NCC^2 of patches of a plane that both views see.
struct PatchNcc {
    static constexpr int kIn = 18, kOut = 1;

    /// A pattern of period 16 px whose contrast is that of `amplitude`, and a finer one of 1/16.
    template <class Real>
    struct Pattern {
        Real amplitude, offset;
        TVSGS_HD Real operator()(int x, int y) const {
            const int a = (x + 3 * y) & 15, b = (5 * x + 2 * y) & 7;
            return Real(0.5) +
                   amplitude * ((a < 8 ? Real(a) : Real(16 - a)) / 8 + Real(b) / 32 + offset);
        }
    };
    static void make(Case& make, double focal, double contrast, double cosine) {
        const double angle = make.uniform(0.05, 0.15);
        const Mat3<double> R = rotation(normalize(Quat<double>{1, 0, -angle / 2, 0}));
        const Vec3d p{0, 0, 4}, there{20 / focal, 8 / focal, 4};
        make.put(R), make.put(there - R * p), make.put(focal);
        make.put(contrast), make.put(cosine), make.put(make.uniform(0, 6.28));
        make.put(make.uniform(900, 1100)), make.put(make.uniform(700, 900));
    }
    template <class Real>
    struct Parts {
        ViewPair<Real> views;
        Real contrast;
        Vec3<Real> normal;
        Vec2<Real> centre;
    };
    template <class Real>
    TVSGS_HD static Parts<Real> parts(const Real* numbers) {
        Feed<Real> in{numbers};
        const ViewPair<Real> views = Reprojected::pair(in);
        const Real contrast = in.number(), cosine = in.number(), turn = in.number();
        const Real sine = std::sqrt(1 - cosine * cosine);
        return {
            views, contrast, {sine * std::cos(turn), sine * std::sin(turn), -cosine}, in.vec2()};
    }
    template <class Real>
    TVSGS_HD static void evaluate(const Real* numbers, Real* out) {
        const Parts<Real> p = parts(numbers);
        const Real distance = -4 * p.normal.z;
        const Pattern<Real> here{p.contrast, 0}, there{Real(0.7) * p.contrast, Real(0.1)};
        const PatchScore<Real> score = patch_score(p.views, p.centre, p.normal, distance, here,
                                                   there, Vec2<Real>{Real(0.5), Real(0.5)});
        out[0] = score.valid ? score.error : Real(kMaxPatchError);
    }
    static double size(const double*, const double*) { return 1; }
    static double bound(const double* numbers, const double*) {
        const auto p = parts(numbers);
        // The other view's samples move by this many px; per px the pattern changes by at most half
        // its deviation. Intensities lie near 1/2.
        const double px = kRounding * (p.views.reference.fx / -p.normal.z + 2000);
        return std::min(kMaxPatchError, 2 * px + 8 * kRounding / p.contrast);
    }
};
struct PatchFocal : PatchNcc {
    static constexpr RowText text{"homography: error of a patch", "focal length, px",
                                  "2 x (f roundings + 1 of 2,000 px) + 8 roundings / contrast", ""};
    static constexpr double kFrom = 50, kTo = 1e5;
    static void fill(double stress, Case& make) { PatchNcc::make(make, stress, 0.3, 0.9); }
};
struct PatchGrazing : PatchNcc {
    static constexpr RowText text{"homography: error of a patch", "1 / cosine of the angle of view",
                                  "2 x (f roundings / cosine + 1 of 2,000 px), at most 0.9",
                                  "no plane, or error above 0.9: not compared"};
    static constexpr double kFrom = 1.01, kTo = 1e4;
    static void fill(double stress, Case& make) { PatchNcc::make(make, 1000, 0.3, 1 / stress); }
};
struct PatchContrast : PatchNcc {
    static constexpr RowText text{
        "homography: error of a patch", "1 / contrast",
        "8 roundings / contrast + those of the place, at most 0.9",
        "1e-8 under the fraction: patches of one colour are not compared"};
    static constexpr double kFrom = 2, kTo = 1e8;
    static void fill(double stress, Case& make) { PatchNcc::make(make, 1000, 1 / stress, 0.9); }
};

/// What a view says about a voxel, in truncations. The reference is the definition, in double.
struct Observed {
    static constexpr int kIn = 21, kOut = 1;

    /// The image is one pixel, which sees the voxel near to its middle.
    static void make(Case& make, double focal, double depth, double truncation) {
        const Mat3<double> R = make.rotation_matrix();
        const Vec3d t = depth * make.direction();
        const double u = make.uniform(-0.3, 0.3), v = make.uniform(-0.3, 0.3);
        const Vec3d p = depth * Vec3d{u, v, 1};
        make.put(R), make.put(t), make.put(focal), make.put(transpose_times(R, p - t));
        make.put(0.5 - focal * u), make.put(0.5 - focal * v);
        make.put(depth + truncation * make.uniform(-0.5, 0.5)), make.put(truncation);
    }
    TVSGS_HD static void observe_twin(const float* numbers, float* out) {
        Feed<float> in{numbers};
        Camera camera;
        camera.camera_from_world.R = in.mat3(), camera.camera_from_world.t = in.vec3();
        camera.fx_px = camera.fy_px = in.number();
        const Vec3f p = in.vec3();
        camera.cx_px = in.number(), camera.cy_px = in.number();
        camera.width_px = camera.height_px = 1;
        const float depth = in.number();
        const VoxelSpace space{1, in.number(), {}};
        const Observation o = observe(camera, {&depth, 1}, space, p);
        out[0] = o.valid ? o.tsdf : -2.0f;
    }
    TVSGS_HD static void observe_twin(const double* numbers, double* out) {
        Feed<double> in{numbers};
        const Mat3<double> R = in.mat3();
        const Vec3d t = in.vec3();
        const double f = in.number();
        const Vec3d p = R * in.vec3() + t;
        const double cx = in.number(), cy = in.number(), depth = in.number();
        const double length = norm(Vec3d{(0.5 - cx) / f, (0.5 - cy) / f, 1});
        const double tsdf = (depth - p.z) * length / in.number();
        out[0] = tsdf < 1 ? tsdf : 1;
    }
    template <class Real>
    TVSGS_HD static void evaluate(const Real* numbers, Real* out) {
        observe_twin(numbers, out);
    }
    static double size(const double*, const double*) { return 1; }
    static double bound(const double* in, const double*) {
        return kRounding * (8 + 4 * motion(in) / in[19]);
    }
    /// Roundings of a place in the camera's frame: of the world's coordinates and the translation.
    static double motion(const double* numbers) {
        Feed<double> in{numbers};
        in.mat3();
        const Vec3d t = in.vec3();
        in.number();
        return norm(t) + 3 * norm(in.vec3());
    }
};
struct FusionDepth : Observed {
    static constexpr RowText text{"fusion: signed distance, truncations", "depth / truncation",
                                  "4 roundings of the largest coordinate / truncation",
                                  "a truncation below half the size of a pixel there is refused"};
    static constexpr double kFrom = 10, kTo = 1e5;
    static void fill(double stress, Case& make) { Observed::make(make, 1000, 4, 4 / stress); }
};
struct FusionFocal : Observed {
    static constexpr RowText text{"fusion: signed distance, truncations", "focal length, px",
                                  "4 roundings of the largest coordinate / truncation", ""};
    static constexpr double kFrom = 50, kTo = 1e5;
    static void fill(double stress, Case& make) { Observed::make(make, stress, 4, 0.04); }
};
struct FusionScale : Observed {
    static constexpr RowText text{"fusion: signed distance, truncations", "size of the scene",
                                  "4 roundings of the largest coordinate / truncation", ""};
    static constexpr double kFrom = 1e-6, kTo = 1e6;
    static void fill(double stress, Case& make) {
        Observed::make(make, 1000, 4 * stress, 0.04 * stress);
    }
};
/// The running mean of many views.
struct FusionViews {
    static constexpr RowText text{"fusion: mean over views", "views",
                                  "8 + 1.5 roundings per view, each fading as 1 / views", ""};
    static constexpr int kIn = 2, kOut = 2;
    static constexpr double kFrom = 1, kTo = 1e5;
    static void fill(double stress, Case& make) {
        make.put(std::floor(stress)), make.put(make.uniform(0.1, 0.9));
    }
    TVSGS_HD static float sample(float level, int i) {
        return level * (1 + float(i % 17 - 8) / 16);
    }
    TVSGS_HD static void mean_twin(const float* in, float* out) {
        Voxel voxel;
        for (int i = 0; i < static_cast<int>(in[0]); ++i) {
            const float x = sample(in[1], i);
            fuse(voxel, x, {x, x, x});
        }
        out[0] = voxel.tsdf, out[1] = voxel.color.y;
    }
    TVSGS_HD static void mean_twin(const double* in, double* out) {
        const int count = static_cast<int>(in[0]);
        out[0] = out[1] = 0;
        for (int i = 0; i < count; ++i) {
            const double x = double(sample(float(in[1]), i)) / count;
            out[0] += x, out[1] += x < 1.0 / count ? x : 1.0 / count;
        }
    }
    template <class Real>
    TVSGS_HD static void evaluate(const Real* in, Real* out) {
        mean_twin(in, out);
    }
    static double size(const double*, const double*) { return 1; }
    static double bound(const double* in, const double*) { return kRounding * (8 + 1.5 * in[0]); }
};

/// Where a point of a scene `offset` from its origin lies in the image, px. `kMoved`: the reader
/// has taken the scene's origin off in double, as read_scene does.
template <bool kMoved>
struct FarCentre {
    static constexpr int kIn = 22, kOut = 2;

    /// Numbers of the file are sums: a whole offset and the place in the scene.
    static void fill(double stress, Case& make) {
        const auto whole = [&](double share) { return std::floor(share * stress); };
        const Vec3d offset{whole(make.uniform(0.4, 0.8)), whole(make.uniform(0.4, 0.8)),
                           whole(make.uniform(0, 1e-4))};
        make.put(offset);
        const Mat3<double> R = make.rotation_matrix();
        const Vec3d centre = 2 * make.direction();
        const Vec3d p{4 * make.uniform(-0.3, 0.3), 4 * make.uniform(-0.3, 0.3), 4};
        make.put(R), make.put(centre), make.put(centre + transpose_times(R, p)), make.put(1000);
    }
    template <class Real>
    TVSGS_HD static void evaluate(const Real* numbers, Real* out) {
        Feed<Real> in{numbers};
        const Vec3d offset = vec_cast<double>(in.vec3());
        const Mat3<Real> R = in.mat3();
        const Vec3d centre = vec_cast<double>(in.vec3()) + offset,
                    point = vec_cast<double>(in.vec3()) + offset;
        const Real f = in.number();
        const Vec3d origin = kMoved ? offset : Vec3d{};
        // The camera's translation is made in double, as the reader does, and stored.
        const Vec3<Real> t = vec_cast<Real>(-(mat_cast<double>(R) * (centre - origin)));
        const Vec3<Real> p = R * vec_cast<Real>(point - origin) + t;
        out[0] = f * p.x / p.z, out[1] = f * p.y / p.z;
    }
    static double size(const double*, const double*) { return 1; }
    static double bound(const double* numbers, const double*) {
        Feed<double> in{numbers};
        const double offset = kMoved ? 0 : norm(in.vec3());
        return kRounding * 1000 / 4 * (8 * 6 + 8 * offset);
    }
};
struct FarMoved : FarCentre<true> {
    static constexpr RowText text{
        "projection: centre, px", "distance from the origin, world units (origin moved)",
        "48 roundings of f / z, at any distance",
        "read_scene moves the origin in double; every file that is written has it added again"};
    static constexpr double kFrom = 1, kTo = 1e7;
};
struct FarAsGiven : FarCentre<false> {
    static constexpr RowText text{
        "projection: centre, px", "distance from the origin, world units (as given)",
        "8 roundings of the distance x f / z: why the origin is moved", "see the row above"};
    static constexpr double kFrom = 1, kTo = 1e4;
};

}  // namespace tvsgs::stability
