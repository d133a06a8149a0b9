#include "render/photometric/photometric.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

using test::central_difference;
using test::close;

TEST(SsimMath, WindowSumsToOne) {
    double sum = 0;
    for (int i = -kSsimRadius; i <= kSsimRadius; ++i) sum += ssim_weight<double>(i);
    EXPECT_NEAR(sum, 1, 1e-15);
    EXPECT_NEAR(ssim_weight<double>(1) / ssim_weight<double>(0), std::exp(-0.5 / 2.25), 1e-14);
}

TEST(SsimMath, TermsAgainstDifferences) {
    const SsimMoments<double> m{0.4, 0.5, 0.2, 0.29, 0.21};
    const auto t = ssim_terms(m);
    const auto moved = [&](double SsimMoments<double>::*entry) {
        return central_difference(
            [&](double h) {
                auto n = m;
                n.*entry += h;
                return ssim_terms(n).ssim;
            },
            1e-4);
    };
    EXPECT_TRUE(close(t.dS_dx, moved(&SsimMoments<double>::x), 1e-7));
    EXPECT_TRUE(close(t.dS_dxx, moved(&SsimMoments<double>::xx), 1e-7));
    EXPECT_TRUE(close(t.dS_dxy, moved(&SsimMoments<double>::xy), 1e-7));
    const SsimMoments<double> equal{0.4, 0.4, 0.2, 0.2, 0.2};
    EXPECT_DOUBLE_EQ(ssim_terms(equal).ssim, 1);
}

constexpr int kWidth = 23, kHeight = 17;  // smaller than a block plus halo, and no multiple of it
constexpr PhotometricWeights kWeights{0.8f, 0.2f};

/// The loss straight from its definition, in double.
double naive_loss(const std::vector<Vec3d>& x, const std::vector<std::uint8_t>& photo) {
    double l1 = 0, ssim = 0;
    for (int c = 0; c < 3; ++c)
        for (int y0 = 0; y0 < kHeight; ++y0)
            for (int x0 = 0; x0 < kWidth; ++x0) {
                SsimMoments<double> m;
                for (int y = std::max(0, y0 - 5); y <= std::min(kHeight - 1, y0 + 5); ++y)
                    for (int xx = std::max(0, x0 - 5); xx <= std::min(kWidth - 1, x0 + 5); ++xx) {
                        const double w = ssim_weight<double>(y - y0) * ssim_weight<double>(xx - x0);
                        const std::size_t p = static_cast<std::size_t>(y * kWidth + xx);
                        const double a = x[p][c],
                                     b = photo[3 * p + static_cast<std::size_t>(c)] / 255.0;
                        m.x += w * a, m.y += w * b, m.xx += w * a * a, m.yy += w * b * b,
                            m.xy += w * a * b;
                    }
                const std::size_t p = static_cast<std::size_t>(y0 * kWidth + x0);
                l1 += std::abs(x[p][c] - photo[3 * p + static_cast<std::size_t>(c)] / 255.0);
                ssim += ssim_terms(m).ssim;
            }
    const double count = 3.0 * kWidth * kHeight;
    return 0.8 * l1 / count + 0.2 * (1 - ssim / count);
}

struct Images {
    std::vector<Vec3f> color;
    std::vector<std::uint8_t> photo;
};
Images random_images() {
    test::Random random(14);
    Images images;
    for (int p = 0; p < kWidth * kHeight; ++p) {
        images.color.push_back({float(random.uniform(-0.1, 1.2)), float(random.uniform(0, 1)),
                                float(random.uniform(0, 1))});
        for (int c = 0; c < 3; ++c)
            images.photo.push_back(static_cast<std::uint8_t>(random.uniform(0, 255.9)));
    }
    return images;
}

template <class Device>
std::pair<double, std::vector<Vec3f>> run(const Images& images) {
    const auto color = to_device<Device>(images.color);
    const auto photo = to_device<Device>(images.photo);
    Buffer<Vec3f, Device> gradient(images.color.size());
    Buffer<float, Device> loss(images.color.size());
    gradient.fill_zero();
    PhotometricScratch<Device> scratch;
    photometric_loss(
        {color.span(), photo.span(), kWidth, kHeight, kWeights, gradient.span(), loss.span()},
        scratch);
    double sum = 0;
    for (float l : to_host(loss)) sum += static_cast<double>(l);
    return {sum, to_host(gradient)};
}

TEST(Photometric, ValueAndGradientAgainstTheDefinition) {
    const Images images = random_images();
    const auto [loss, gradient] = run<Cpu>(images);
    std::vector<Vec3d> x;
    for (Vec3f c : images.color) x.push_back(vec_cast<double>(c));
    EXPECT_TRUE(close(loss, naive_loss(x, images.photo), 1e-6));  // float sums of about 1000 terms
    for (std::size_t p : {0ul, 5ul, 22ul, 100ul, 200ul, 390ul})
        for (int c = 0; c < 3; ++c) {
            const double kept = x[p][c];
            const auto value = [&](double t) {
                x[p][c] = kept + t;
                const double v = naive_loss(x, images.photo);
                x[p][c] = kept;
                return v;
            };
            // Float variances E[x^2] - E[x]^2 cancel to about 1e-5 relative; scaled by the typical
            // gradient 1/(3HW).
            EXPECT_TRUE(close(gradient[p][c], central_difference(value, 1e-5), 5e-4, 2e-4)) << p;
        }
}

TEST(Photometric, EqualImagesHaveNoGradient) {
    Images images = random_images();
    for (std::size_t p = 0; p < images.color.size(); ++p)
        for (int c = 0; c < 3; ++c)
            images.color[p][c] =
                static_cast<float>(images.photo[3 * p + static_cast<std::size_t>(c)]) / 255;
    const auto [loss, gradient] = run<Cpu>(images);
    EXPECT_NEAR(loss, 0, 1e-6);
    for (Vec3f g : gradient) EXPECT_LT(norm(g), 1e-7f);
}

TEST(PhotometricTwin, CpuAgainstCuda) {
    if (const std::string reason = test::no_cuda(); !reason.empty()) GTEST_SKIP() << reason;
    if constexpr (kHasCuda) {
        const Images images = random_images();
        const auto cpu = run<Cpu>(images), cuda = run<Cuda>(images);
        EXPECT_TRUE(close(cpu.first, cuda.first, 1e-6));
        // The variances cancel in float on both sides, in different orders.
        for (std::size_t p = 0; p < cpu.second.size(); ++p)
            EXPECT_LT(norm(cpu.second[p] - cuda.second[p]), 2e-6f);
    }
}

}  // namespace
}  // namespace tvsgs
