// A gain, an offset and a colour matrix per photograph: derivatives, what they find, and when the
// plan asks for which.
#include <cmath>

#include "optim/multiview_case.h"
#include "optim/plan.h"
#include "support/numeric.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

TEST(ExposedColor, DerivativesOfBothModels) {
    test::Random random(3);
    for (const int count : {kGainValues, kAffineValues}) {
        double values[kAffineValues];
        for (double& value : values) value = random.uniform(-0.5, 0.5);
        const Vec3d color{0.3, 0.8, 0.5}, dL{0.7, -0.4, 0.2};
        const auto vjp = exposed_vjp(values, count, color, dL);
        for (int k = 0; k < kAffineValues; ++k) {
            const double numeric = test::central_difference([&](double h) {
                double moved[kAffineValues];
                std::copy(values, values + kAffineValues, moved);
                moved[k] += h;
                return dot(dL, exposed(moved, count, color));
            });
            EXPECT_NEAR(vjp.dL_dvalues[k], numeric, 1e-8) << k << " of " << count;
        }
        for (int c = 0; c < 3; ++c) {
            const double numeric = test::central_difference([&](double h) {
                Vec3d moved = color;
                moved[c] += h;
                return dot(dL, exposed(values, count, moved));
            });
            EXPECT_NEAR(vjp.dL_dcolor[c], numeric, 1e-8) << c << " of " << count;
        }
    }
}

TEST(ExposedColor, ZerosChangeNothing) {
    const double zeros[kAffineValues] = {};
    const Vec3d color{0.3, 0.8, 0.5};
    for (const int count : {kGainValues, kAffineValues})
        for (int c = 0; c < 3; ++c) EXPECT_EQ(exposed(zeros, count, color)[c], color[c]);
}

/// The photograph has more red, less blue, and some green in its red.
Vec3d other_light(Vec3d c) {
    return {1.15 * c.x + 0.1 * c.y, c.y, 0.8 * c.z + 0.02};
}

test::ExposureCase colored_case(float pull) {
    test::ExposureCase c;
    c.model = ExposureModel::affine, c.pull = pull;
    test::Random random(9);
    for (int i = 0; i < c.width * c.height; ++i) {
        const double base = 0.45 + 0.2 * std::sin(0.7 * i);
        const Vec3d color{base, base + random.uniform(-0.2, 0.2), 0.2 + random.uniform(0, 0.4)};
        c.color.push_back(vec_cast<float>(color));
        for (int k = 0; k < 3; ++k)
            c.photo.push_back(static_cast<std::uint8_t>(
                std::clamp(255 * other_light(color)[k], 0.0, 255.0) + 0.5));
    }
    return c;
}

double error_of(const test::ExposureCase& c, const test::ExposureResult& r, int count) {
    double sum = 0;
    for (std::size_t i = 0; i < c.color.size(); ++i) {
        const Vec3f shown = exposed(r.states[1].value, count, c.color[i]);
        for (int k = 0; k < 3; ++k)
            sum += std::abs(static_cast<double>(shown[k]) -
                            c.photo[3 * i + static_cast<std::size_t>(k)] / 255.0);
    }
    return sum / (3 * static_cast<double>(c.color.size()));
}

TEST(Exposure, AMatrixFindsOtherLight) {
    const test::ExposureCase free = colored_case(0);
    const auto matrix = test::evaluate_exposure<Cpu>(free, 1500);
    test::ExposureCase gain = free;
    gain.model = ExposureModel::gain;
    const auto plain = test::evaluate_exposure<Cpu>(gain, 1500);
    EXPECT_LT(error_of(free, matrix, kAffineValues), 0.006) << "the photograph has steps of 0.004";
    EXPECT_GT(error_of(free, plain, kGainValues), 0.04);
    EXPECT_EQ(matrix.states[0].value[5], 0) << "the other photograph was never looked at";
}

TEST(Exposure, ThePullGoesFromMatrixToGain) {
    double last = 0;
    for (const float pull : {0.0f, 0.05f, 100.0f}) {
        const test::ExposureCase c = colored_case(pull);
        const auto r = test::evaluate_exposure<Cpu>(c, 1500);
        const double error = error_of(c, r, kAffineValues);
        EXPECT_GT(error, last) << pull;
        last = error;
        double squares = 0;
        for (int k = kGainValues; k < kAffineValues; ++k)
            squares += std::pow(static_cast<double>(r.states[1].value[k]), 2);
        if (pull == 100.0f) {
            EXPECT_LT(squares, 1e-4) << "none: today's gain and offset";
        } else {
            EXPECT_GT(squares, 1e-3) << pull;
        }
    }
    EXPECT_GT(last, 0.04);
}

TEST(Exposure, TheReportedLossHasThePull) {
    test::ExposureCase c = colored_case(0.5f);
    const auto free = test::evaluate_exposure<Cpu>(colored_case(0), 2),
               pulled = test::evaluate_exposure<Cpu>(c, 2);
    // Adam's first step is its rate whatever the derivative, so the second look sees 1e-3 each.
    EXPECT_NEAR(pulled.last_value - free.last_value, 0.5 * 12 * 1e-6, 1e-7);
}

}  // namespace
}  // namespace tvsgs
