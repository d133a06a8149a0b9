// Shared parts of the tests of tvsgs-view's pages.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "report/view_page.h"
#include "support/browser.h"
#include "support/random_gaussians.h"

namespace tvsgs {

namespace fs = std::filesystem;

inline constexpr int kWidth = 320, kHeight = 240;

inline fs::path folder(const std::string& name) {
    const fs::path path =
        fs::path(testing::TempDir()) / ("tvsgs_view_" + name + std::to_string(::getpid()));
    fs::remove_all(path);
    fs::create_directories(path);
    return path;
}

inline ViewRun run_of(const std::string& name, const std::string& backbone, Gaussians<Cpu> splats) {
    ViewRun run;
    run.name = name;
    run.train.backbone = backbone;
    run.splats = std::move(splats);
    return run;
}

inline std::vector<ViewCamera> two_cameras() {
    std::vector<ViewCamera> cameras(2);
    for (int i = 0; i < 2; ++i) {
        ViewCamera& c = cameras[static_cast<std::size_t>(i)];
        c.name = i ? "right.jpg" : "left.jpg", c.test = i == 1;
        c.camera = test::test_camera(kWidth, kHeight, i ? 0.3f : -0.4f);
        c.photo = ImageU8(64, 48, 3, 90);
    }
    return cameras;
}

class ViewInBrowser : public testing::Test {
protected:
    void SetUp() override {
        if (chromium().empty())
            GTEST_SKIP() << "no chromium that starts here: what the page draws is not compared";
    }
};

}  // namespace tvsgs
