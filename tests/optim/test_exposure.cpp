// Derivatives of the exposure formula. test_multiview_losses.cpp tests the fit.
#include <gtest/gtest.h>

#include "optim/photo/exposure.h"
#include "support/numeric.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

TEST(ExposedColor, Derivatives) {
    test::Random random(3);
    double values[kExposureValues];
    for (double& value : values) value = random.uniform(-0.5, 0.5);
    const Vec3d color{0.3, 0.8, 0.5}, dL{0.7, -0.4, 0.2};
    const auto vjp = exposed_vjp(values, color, dL);
    for (int k = 0; k < kExposureValues; ++k) {
        const double numeric = test::central_difference([&](double h) {
            double moved[] = {values[0], values[1]};
            moved[k] += h;
            return dot(dL, exposed(moved, color));
        });
        EXPECT_NEAR(vjp.dL_dvalues[k], numeric, 1e-8) << k;
    }
    for (int c = 0; c < 3; ++c) {
        const double numeric = test::central_difference([&](double h) {
            Vec3d moved = color;
            moved[c] += h;
            return dot(dL, exposed(values, moved));
        });
        EXPECT_NEAR(vjp.dL_dcolor[c], numeric, 1e-8) << c;
    }
}

TEST(ExposedColor, ZerosChangeNothing) {
    const double zeros[kExposureValues] = {};
    const Vec3d color{0.3, 0.8, 0.5};
    for (int c = 0; c < 3; ++c) EXPECT_EQ(exposed(zeros, color)[c], color[c]);
}

}  // namespace
}  // namespace tvsgs
