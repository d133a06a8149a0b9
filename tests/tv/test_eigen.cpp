#include "core/math/eigen.h"
#include "tv/tv_support.h"

namespace tvsgs::test {
namespace {

template <class Real>
Sym3<Real> compose(const Mat3<Real>& V, Vec3<Real> l) {
    const auto entry = [&](int i, int j) {
        return l.x * V[i][0] * V[j][0] + l.y * V[i][1] * V[j][1] + l.z * V[i][2] * V[j][2];
    };
    return {entry(0, 0), entry(0, 1), entry(0, 2), entry(1, 1), entry(1, 2), entry(2, 2)};
}

template <class Real>
double largest_difference(const Sym3<Real>& a, const Sym3<Real>& b) {
    return double(std::max({std::abs(a.xx - b.xx), std::abs(a.xy - b.xy), std::abs(a.xz - b.xz),
                            std::abs(a.yy - b.yy), std::abs(a.yz - b.yz), std::abs(a.zz - b.zz)}));
}

template <class Real>
void expect_rotation(const Mat3<Real>& V, double tolerance) {
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            EXPECT_NEAR(dot(column(V, i), column(V, j)), i == j ? 1 : 0, tolerance);
    EXPECT_NEAR(dot(cross(column(V, 0), column(V, 1)), column(V, 2)), 1,
                tolerance);  // right-handed
}

TEST(Eigen, KnownMatrices) {
    // [[2, 1, 0], [1, 2, 0], [0, 0, 5]]: values 5, 3, 1; the smallest belongs to (1, -1, 0).
    const auto e = sym_eigen(Sym3<double>{2, 1, 0, 2, 0, 5});
    EXPECT_NEAR(e.values.x, 5, 1e-14);
    EXPECT_NEAR(e.values.y, 3, 1e-14);
    EXPECT_NEAR(e.values.z, 1, 1e-14);
    EXPECT_NEAR(angle_deg(column(e.vectors, 2), {std::sqrt(0.5), -std::sqrt(0.5), 0}), 0, 1e-12);
    expect_rotation(e.vectors, 1e-14);

    const auto diagonal = sym_eigen(Sym3<double>{-1, 0, 0, 7, 0, 3});
    EXPECT_EQ(diagonal.values.x, 7);
    EXPECT_EQ(diagonal.values.y, 3);
    EXPECT_EQ(diagonal.values.z, -1);
}

TEST(Eigen, EqualValuesAndZero) {
    for (const Vec3<double> l : {Vec3<double>{1, 1, 1}, {2, 2, 1}, {2, 1, 1}, {0, 0, 0}}) {
        Random random(3);
        const Mat3<double> V = rotation(quat_cast<double>(random.quat()));
        const auto e = sym_eigen(compose(V, l));
        // The quaternion is of unit length to float accuracy only.
        for (int i = 0; i < 3; ++i) EXPECT_NEAR(e.values[i], l[i], 1e-6);
        expect_rotation(e.vectors, 1e-14);
    }
}

TEST(Eigen, RandomMatricesAreReconstructedAtAnyScale) {
    Random random(1);
    for (int trial = 0; trial < 500; ++trial) {
        const Sym3<double> A{random.normal(), random.normal(), random.normal(),
                             random.normal(), random.normal(), random.normal()};
        const auto e = sym_eigen(A);
        EXPECT_LT(largest_difference(compose(e.vectors, e.values), A),
                  1e-14 * 10);  // ten roundings of entries up to 5
        EXPECT_GE(e.values.x, e.values.y);
        EXPECT_GE(e.values.y, e.values.z);
        expect_rotation(e.vectors, 1e-14);
        const auto values = sym_eigenvalues(A);
        for (int i = 0; i < 3; ++i) EXPECT_EQ(values[i], e.values[i]);

        for (const float scale : {1e-30f, 1.0f, 1e30f}) {
            const Sym3f F{float(A.xx) * scale, float(A.xy) * scale, float(A.xz) * scale,
                          float(A.yy) * scale, float(A.yz) * scale, float(A.zz) * scale};
            const auto f = sym_eigen(F);
            // A few roundings (6e-8) of the largest value, which is below 10.
            for (int i = 0; i < 3; ++i)
                EXPECT_NEAR(double(f.values[i]) / double(scale), e.values[i], 1e-5);
            expect_rotation(f.vectors, 2e-6);
        }
    }
}

TEST(Eigen, SaliencyOfPlatesInFloat) {
    // Nearly equal large values occur on ideal surfaces; closed forms lose four digits there.
    Random random(2);
    double worst = 0;
    for (int trial = 0; trial < 2000; ++trial) {
        const Mat3<double> V = rotation(normalize(quat_cast<double>(random.quat())));
        const auto A = compose(V, {1, 1 - 1e-3 * random.uniform(), 0.05 * random.uniform()});
        const Sym3f F{float(A.xx), float(A.xy), float(A.xz), float(A.yy), float(A.yz), float(A.zz)};
        const auto exact = sym_eigenvalues(Sym3<double>{F.xx, F.xy, F.xz, F.yy, F.yz, F.zz});
        const auto values = sym_eigenvalues(F);
        worst =
            std::max(worst, std::abs(double(values.y) - values.z - (exact.y - exact.z)) / exact.x);
    }
    EXPECT_LT(worst, 5e-7);  // measured by the design: 3e-7; eight roundings of 6e-8
}

TEST(Eigen, NotANumberComesThrough) {
    const float nan = std::nanf("");
    EXPECT_TRUE(std::isnan(sym_eigenvalues(Sym3f{1, nan, 0, 1, 0, 1}).x +
                           sym_eigenvalues(Sym3f{1, nan, 0, 1, 0, 1}).y));
}

}  // namespace
}  // namespace tvsgs::test
