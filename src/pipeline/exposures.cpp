#include "pipeline/exposures.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <string_view>

#include "core/error.h"
#include "core/log.h"
#include "io/atomic_file.h"
#include "io/json_value.h"
#include "io/read_file.h"
#include "optim/exposure.h"

namespace tvsgs {
namespace {

constexpr double kVersion1 = 1;

std::string file_of(const std::string& run) {
    return run + "/exposure.json";
}

std::vector<float> values_of(const JsonValue& of_view) {
    std::vector<float> values;
    for (const JsonValue& value : of_view.items)
        values.push_back(static_cast<float>(value.number_or(NAN)));
    return values;
}

bool are_usable(const std::vector<float>& values) {
    return (values.size() == kGainValues || values.size() == kAffineValues) &&
           std::all_of(values.begin(), values.end(), [](float v) { return std::abs(v) < 10; });
}

}  // namespace

bool has_exposures(const std::string& run) {
    std::error_code code;
    return std::filesystem::is_regular_file(file_of(run), code);
}

void write_exposures(const std::string& run,
                     const Scene& scene,
                     const std::vector<std::vector<float>>& values) {
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
        throw Error(ExitCode::input,
                    str(run,
                        ": has no exposure.json; loss.photometric.exposure_from expects a finished "
                        "run that has fitted the exposure of its photographs "
                        "(loss.photometric.exposure=true)"));
    const JsonValue root = parse_json_value(read_bytes(file), file);
    if (root["version"].number_or(-1) != kVersion1)
        throw Error(ExitCode::input, str(file, ": expected version 1 of exposures"));
    std::map<std::string_view, const JsonValue*> of_name;
    for (const auto& [name, value] : root["views"].members) of_name[name] = &value;
    HeldExposures held;
    for (const View& view : train) {
        const auto found = of_name.find(view.name);
        if (found == of_name.end())
            throw Error(ExitCode::input,
                        str(file, ": has no exposure of ", view.name, ", one of ", train.size(),
                            " training views; expected a run of a scene with all of them "
                            "(loss.photometric.exposure_from)"));
        held.push_back(values_of(*found->second));
        if (!are_usable(held.back()) || held.back().size() != held.front().size())
            throw Error(ExitCode::input,
                        str(file, ": ", view.name, ": expected ", kGainValues, " or ",
                            kAffineValues, " numbers, as many of each view"));
    }
    options.held = std::make_shared<const HeldExposures>(std::move(held));
    spdlog::info("exposure of {} photographs is held as {} has fitted it", train.size(), run);
}

}  // namespace tvsgs
