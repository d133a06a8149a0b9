// Prints the largest error, bound and share of each row: print_stability_table [auto|cpu|cuda].
// docs/develop/stability.md
#include <algorithm>
#include <cstdio>

#include "core/device/device_choice.h"
#include "stability/measure.h"

int main(int argc, char** argv) {
    using namespace tvsgs;
    const DeviceChoice device = choose_device(argc > 1 ? argv[1] : "auto");
    std::printf("float32 on %s against double\n%-44s %-52s %15s %9s %9s %6s\n",
                device.description.c_str(), "operation", "stress", "range", "error", "bound",
                "share");
    for (const StabilityCurve& c :
         on_device(device, [](auto tag) { return measure_stability(tag); })) {
        double error = 0, bound = 0;
        for (const StabilityPoint& p : c.points)
            error = std::max(error, p.error), bound = std::max(bound, p.bound);
        std::printf("%-44s %-52s %7.0e-%7.0e %9.1e %9.1e %6.2f\n", c.operation.c_str(),
                    c.stress.c_str(), c.points.front().stress, c.points.back().stress, error, bound,
                    c.worst().share);
    }
}
