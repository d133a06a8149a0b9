// Fixture of the tests of the scene reader.
#pragma once

#include <set>
#include <string>

#include "io/io_test.h"
#include "io/scene/scene_reader.h"

namespace tvsgs {

/// A scene of four views of 8x6 pixels on a line, and points with known tracks.
class SceneReader : public IoTest {
protected:
    SceneOptions options;

    void SetUp() override {
        IoTest::SetUp();
        options.path = folder.string();
        camera("1 PINHOLE 8 6 10 11 4 3");
        std::string images;
        for (int i = 0; i < 4; ++i) {
            images += str(i + 1, " 1 0 0 0 ", -i, " 0 0 1 ", i, ".png\n\n");
            photo(str("images/", i, ".png"), 8, 6, static_cast<std::uint8_t>(10 * i));
        }
        write("sparse/0/images.txt", images);
        // x lists the images that see the point: 1, 2; 2, 3, 4; 4 twice; none.
        write("sparse/0/points3D.txt",
              "1 12 0 5 255 0 0 0.1 1 0 2 0\n2 234 0 5 0 255 0 0.1 2 1 3 0 4 0\n3 44 0 5 0 0 255 "
              "0.1 4 1 4 2\n4 0 0 5 0 0 0 0.1\n");
    }
    void camera(const std::string& line) { write("sparse/0/cameras.txt", line + "\n"); }
    void photo(
        const std::string& name, int width, int height, std::uint8_t value, int channels = 3) {
        replace_png((folder / name).string(), ImageU8(width, height, channels, value));
    }
    Scene read() const { return read_scene(options); }
    void expect_input_error(const std::string& text) const {
        expect_error(ExitCode::input, text, [&] { read(); });
    }
    static std::set<float> point_names(const Scene& scene) {
        std::set<float> names;
        for (const Vec3f p : scene.points.positions) names.insert(p.x);
        return names;
    }
};

}  // namespace tvsgs
