// A program that links the installed library: trains a scene with the loss of examples/toy_loss.h,
// whose maps ask for half of the photographs' brightness, and writes the splats.
// Usage: train_darker SCENE OUT.ply [ITERATIONS]
#include <cstdlib>
#include <iostream>
#include <memory>

#include "core/error.h"
#include "examples/toy_loss.h"
#include "io/scene/scene_reader.h"
#include "io/splats/ply.h"
#include "optim/loop/train.h"

namespace {

tvsgs::ViewMap half_of_brightness(const tvsgs::ImageU8& photo) {
    tvsgs::ViewMap map{"brightness", photo.width, photo.height};
    for (std::size_t p = 0; p < photo.pixels.size(); p += 3)
        map.values.push_back(
            static_cast<float>(photo.pixels[p] + photo.pixels[p + 1] + photo.pixels[p + 2]) /
            (2 * 3 * 255));
    return map;
}

void train_darker(const char* scene_folder, const char* out, int iterations) {
    tvsgs::SceneOptions where;
    where.path = scene_folder;
    tvsgs::Scene scene = tvsgs::read_scene(where);
    for (tvsgs::View& view : scene.train) view.maps.push_back(half_of_brightness(view.photo));

    using Loss = tvsgs::examples::BrightnessLoss<tvsgs::Cpu>;
    const tvsgs::ScheduledOptions weight{10, 0};
    tvsgs::add_loss<tvsgs::Cpu>(
        {"brightness", weight.weight, Loss::kNeeds},
        [weight](const tvsgs::LossContext&) { return std::make_unique<Loss>(weight); });

    tvsgs::TrainOptions options;
    options.iterations = iterations;
    tvsgs::TrainCallbacks callbacks;
    callbacks.report_due = [](int step) { return step % 100 == 0; };
    callbacks.on_report = [](const tvsgs::TrainReport& report) {
        std::cout << "iteration " << report.step << ": loss " << report.loss << ", "
                  << report.gaussians << " splats\n";
    };
    tvsgs::write_splat_ply(out, tvsgs::train<tvsgs::Cpu>(scene, options, callbacks), scene.origin);
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 3 && argc != 4) {
        std::cerr << "usage: train_darker SCENE OUT.ply [ITERATIONS]\n";
        return 2;
    }
    try {
        train_darker(argv[1], argv[2], argc == 4 ? std::atoi(argv[3]) : 1000);
    } catch (const tvsgs::Error& error) {
        std::cerr << "error: " << error.what() << '\n';
        return static_cast<int>(error.code());
    }
}
