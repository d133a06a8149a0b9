#include "render/tiles/sh_math.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

using test::central_difference;
using test::close;

TEST(ShBasis, OrthonormalOnTheSphere) {
    // A product quadrature that integrates polynomials of degree 6 exactly: 4 Gauss-Legendre
    // latitudes, 8 equal longitudes.
    const double nodes[4] = {-0.8611363115940526, -0.3399810435848563, 0.3399810435848563,
                             0.8611363115940526};
    const double weights[4] = {0.3478548451374538, 0.6521451548625461, 0.6521451548625461,
                               0.3478548451374538};
    double gram[16][16] = {};
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 8; ++j) {
            const double z = nodes[i], r = std::sqrt(1 - z * z), phi = 2 * M_PI * (j + 0.5) / 8;
            double Y[16];
            sh_basis(3, Vec3d{r * std::cos(phi), r * std::sin(phi), z}, Y);
            for (int a = 0; a < 16; ++a)
                for (int b = 0; b < 16; ++b) gram[a][b] += weights[i] * 2 * M_PI / 8 * Y[a] * Y[b];
        }
    // The printed coefficients carry about 16 digits; the sums have 32 terms.
    for (int a = 0; a < 16; ++a)
        for (int b = 0; b < 16; ++b) EXPECT_NEAR(gram[a][b], a == b, 1e-12) << a << " " << b;
}

TEST(ShColor, Vjp) {
    test::Random random(4);
    for (int degree = 0; degree <= 3; ++degree) {
        Vec3d sh[16];
        for (Vec3d& c : sh) c = 0.1 * random.normal3();
        sh[0] = {0.4, 0.3, 0.5};  // colours stay away from the clamp
        const Vec3d offset{0.4, -0.7, 1.3}, w = random.normal3();
        const auto color_at = [&](Vec3d o) {
            return sh_color<double>(degree, normalize(o), sh, 1, 0);
        };
        Vec3d dL_dsh[16] = {};
        AddShGradient<double> add{sh, dL_dsh, 1, 0};
        const Vec3d g = sh_color_vjp(degree, offset, color_at(offset), w, add);
        for (int axis = 0; axis < 3; ++axis) {
            const auto value = [&](double t) {
                Vec3d moved = offset;
                moved[axis] += t;
                return dot(w, color_at(moved));
            };
            EXPECT_TRUE(close(g[axis], central_difference(value), 1e-8)) << "degree " << degree;
        }
        for (int k = 0; k < sh_count(degree); ++k)
            for (int channel = 0; channel < 3; ++channel) {
                const double kept = sh[k][channel];
                const auto value = [&](double t) {
                    sh[k][channel] = kept + t;
                    const double v = dot(w, color_at(offset));
                    sh[k][channel] = kept;
                    return v;
                };
                EXPECT_TRUE(close(dL_dsh[k][channel], central_difference(value), 1e-8));
            }
        for (int k = sh_count(degree); k < 16; ++k) EXPECT_EQ(dL_dsh[k].x, 0);
    }
}

TEST(ShColor, ClampPassesNothing) {
    Vec3d sh[1] = {{-10, 0, 0}}, dL_dsh[1] = {};  // red far below zero
    const Vec3d color = sh_color<double>(0, {0, 0, 1}, sh, 1, 0);
    EXPECT_EQ(color.x, 0);
    EXPECT_DOUBLE_EQ(color.y, 0.5);
    AddShGradient<double> add{sh, dL_dsh, 1, 0};
    sh_color_vjp(0, Vec3d{0, 0, 1}, color, Vec3d{1, 1, 1}, add);
    EXPECT_EQ(dL_dsh[0].x, 0);
    EXPECT_DOUBLE_EQ(dL_dsh[0].y, kShC0);
}

TEST(ShColor, AtTheCameraCentreNothingIsNan) {
    Vec3d sh[16] = {}, dL_dsh[16] = {};
    AddShGradient<double> add{sh, dL_dsh, 1, 0};
    const Vec3d g = sh_color_vjp(3, Vec3d{0, 0, 0}, Vec3d{0.5, 0.5, 0.5}, Vec3d{1, 1, 1}, add);
    EXPECT_TRUE(is_finite(g));
}

}  // namespace
}  // namespace tvsgs
