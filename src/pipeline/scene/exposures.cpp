#include "pipeline/scene/exposures.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <string_view>

#include "core/error.h"
#include "core/log.h"
#include "io/files/atomic_file.h"
#include "io/files/json_value.h"
#include "io/files/read_file.h"
#include "optim/photo/exposure.h"

namespace tvsgs {
namespace {

constexpr double kVersion1 = 1;

std::string file_of(const std::string& run) {
    return run + "/exposure.json";
}

/// Returns false for values that no fit produces.
bool read_values(const JsonValue& of_view, HeldExposures::value_type& values) {
    if (of_view.items.size() != values.size()) return false;
    for (std::size_t k = 0; k < values.size(); ++k)
        values[k] = float(of_view.items[k].number_or(NAN));
    return std::ranges::all_of(values, [](float v) { return std::abs(v) < 10; });
}

}  // namespace

bool has_exposures(const std::string& run) {
    std::error_code code;
    return std::filesystem::is_regular_file(file_of(run), code);
}

void write_exposures(const std::string& run, const Scene& scene, const HeldExposures& values) {
    JsonValue views = JsonValue::object(), root = JsonValue::object();
    for (std::size_t i = 0; i < scene.train.size(); ++i)
        views.members.emplace_back(scene.train[i].name,
                                   std::vector<double>(values[i].begin(), values[i].end()));
    root.set("version", kVersion1);
    root.set("views", std::move(views));
    write_text_file(file_of(run), json_text(root) + "\n");
}

void read_exposures(PhotometricOptions& options, const std::vector<View>& train) {
    const std::string& run = options.exposure_from;
    options.held = nullptr;
    if (run.empty()) return;
    const std::string file = file_of(run);
    if (!has_exposures(run))
        throw input_error(run,
                          ": no exposure.json; loss.photometric.exposure_from needs "
                          "a finished run with loss.photometric.exposure=true");
    const JsonValue root = parse_json_value(read_bytes(file), file);
    if (root["version"].number_or(-1) != kVersion1)
        throw input_error(file, ": expected version 1 of exposures");
    std::map<std::string_view, const JsonValue*> of_name;
    for (const auto& [name, value] : root["views"].members) of_name[name] = &value;
    HeldExposures held;
    for (const View& view : train) {
        const auto found = of_name.find(view.name);
        if (found == of_name.end())
            throw input_error(file, ": no exposure of ", view.name, ", one of ", train.size(),
                              " training views; give a run with all of them "
                              "(loss.photometric.exposure_from)");
        if (!read_values(*found->second, held.emplace_back()))
            throw input_error(file, ": ", view.name, ": expected ", kExposureValues,
                              " numbers between -10 and 10");
    }
    options.held = std::make_shared<const HeldExposures>(std::move(held));
    spdlog::info("Uses the exposures that {1} fitted, for {0} photographs", train.size(), run);
}

}  // namespace tvsgs
