// Selection of neighbour views per step; only the required ones are rendered.
#include <gtest/gtest.h>

#include <set>

#include "optim/views/neighbour_views.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

/// Counts its renders.
class CountingBackbone final : public Backbone<Cpu> {
public:
    explicit CountingBackbone(int& forwards) : forwards_(forwards) {}
    const RenderedImages<Cpu>& forward(const Gaussians<Cpu>&,
                                       const Camera& camera,
                                       int,
                                       Maps) override {
        ++forwards_;
        const std::size_t pixels = std::size_t(camera.width_px) * std::size_t(camera.height_px);
        copy(std::vector<float>(pixels, 2), images_.depth);
        images_.camera = camera;
        return images_;
    }
    void backward(const Gaussians<Cpu>&, const ImageGradients<Cpu>&, Gaussians<Cpu>&) override {}
    const ScreenStatistics<Cpu>& statistics() const override { return statistics_; }

private:
    int& forwards_;
    RenderedImages<Cpu> images_;
    ScreenStatistics<Cpu> statistics_;
};

/// Three neighbour views, the first one rendered; views are paired with four, one and no others.
TEST(NeighbourViews, AreDifferentAndOnlyRenderedWhereAsked) {
    std::vector<DeviceView<Cpu>> views(5);
    for (int i = 0; i < 5; ++i) {
        views[static_cast<std::size_t>(i)].index = i;
        views[static_cast<std::size_t>(i)].camera = test::test_camera(8, 6);
    }
    int forwards = 0;
    std::vector<std::unique_ptr<Backbone<Cpu>>> backbones(3), one(1);
    backbones[0] = std::make_unique<CountingBackbone>(forwards);
    const ViewPairs pairs{{{1, 2, 3, 4}, {0}, {}}, 0.1f};
    NeighbourViews<Cpu> three(pairs, std::move(backbones), 7), single(pairs, std::move(one), 7);
    std::set<std::vector<int>> seen;
    const Gaussians<Cpu> none;
    for (int step = 1; step <= 200; ++step) {
        const std::vector<int> chosen = three.choose(step, 0);
        ASSERT_EQ(chosen.size(), 3u);
        ASSERT_EQ(std::set<int>(chosen.begin(), chosen.end()).size(), 3u);
        ASSERT_EQ(single.choose(step, 0).at(0), chosen[0]) << "more of them change the first";
        seen.insert(chosen);
        three.begin(step, 0, views, none);
        ASSERT_EQ(three.count(), 3);
        ASSERT_EQ(forwards, step);
        for (int i = 0; i < 3; ++i) {
            EXPECT_EQ(three[i].view().index, chosen[static_cast<std::size_t>(i)]);
            EXPECT_EQ(three[i].rendered(), i == 0);
        }
    }
    EXPECT_EQ(seen.size(), 24u) << "all orders of three out of four";
    EXPECT_EQ(three.choose(1, 1), std::vector<int>{0});
    three.begin(1, 2, views, none);
    EXPECT_EQ(three.count(), 0);
}

}  // namespace
}  // namespace tvsgs
