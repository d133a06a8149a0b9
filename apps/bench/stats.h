// Timings of repeated stages: percentiles, as a table for people and as JSON.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <string>
#include <vector>

#include "io/files/json_value.h"

namespace tvsgs {

/// A percentile with linear interpolation, p in [0, 100]; 0 of nothing.
inline double percentile(std::vector<double> values, double p) {
    if (values.empty()) return 0;
    std::sort(values.begin(), values.end());
    const double at = p / 100 * static_cast<double>(values.size() - 1);
    const std::size_t low = static_cast<std::size_t>(at),
                      high = std::min(low + 1, values.size() - 1);
    return values[low] + (at - static_cast<double>(low)) * (values[high] - values[low]);
}

/// Milliseconds of every repetition of a stage.
struct StageTimes {
    std::string name;
    std::vector<double> ms;
};

/// Stages in the order of their first appearance.
class Timings {
public:
    void add(const std::string& name, double ms) {
        for (StageTimes& stage : stages_)
            if (stage.name == name) {
                stage.ms.push_back(ms);
                return;
            }
        stages_.push_back({name, {ms}});
    }
    double median(const std::string& name) const {
        for (const StageTimes& stage : stages_)
            if (stage.name == name) return percentile(stage.ms, 50);
        return 0;
    }
    JsonValue json() const {
        return json([](const std::string&, double, JsonValue&) {});
    }
    /// more(stage, median in ms, line) may add to each stage's object.
    template <class More>
    JsonValue json(const More& more) const {
        JsonValue list = JsonValue::list();
        for (const StageTimes& stage : stages_) {
            JsonValue line;
            line.add("stage", stage.name)
                .add("median_ms", percentile(stage.ms, 50))
                .add("p10_ms", percentile(stage.ms, 10))
                .add("p90_ms", percentile(stage.ms, 90))
                .add("repetitions", static_cast<int>(stage.ms.size()));
            more(stage.name, percentile(stage.ms, 50), line);
            list.items.push_back(line);
        }
        return list;
    }
    /// To standard error: results go to standard output as JSON.
    void print() const {
        std::fprintf(stderr, "  %-24s %10s %10s %10s\n", "stage", "median ms", "10 %", "90 %");
        for (const StageTimes& stage : stages_)
            std::fprintf(stderr, "  %-24s %10.3f %10.3f %10.3f\n", stage.name.c_str(),
                         percentile(stage.ms, 50), percentile(stage.ms, 10),
                         percentile(stage.ms, 90));
    }

private:
    std::vector<StageTimes> stages_;
};

class Stopwatch {
public:
    double ms() const {
        const auto passed = std::chrono::steady_clock::now() - begin_;
        return std::chrono::duration<double, std::milli>(passed).count();
    }

private:
    std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

}  // namespace tvsgs
