// The subcommands of tvsgs-bench, and timings of repeated stages: JSON goes to standard output,
// tables to standard error.
#pragma once

#include <chrono>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "apps/common/command_line.h"
#include "core/log.h"
#include "core/math/quantile.h"
#include "io/files/atomic_file.h"
#include "io/files/json_value.h"

namespace tvsgs {

/// Agreement with the oracle's stored cases, and times on synthetic splats.
Subcommand add_bench_vote(CLI::App& app);

/// Times of the parts of a training iteration on fixed synthetic views.
Subcommand add_bench_stages(CLI::App& app);

/// p in [0, 100]; 0 of nothing.
inline double percentile(std::vector<double> values, double p) {
    return quantile(values, p / 100);
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
    /// `floor_ms` gives the least possible time of a stage, 0: unknown.
    JsonValue json(const std::function<double(const std::string& stage)>& floor_ms = {}) const {
        JsonValue list = JsonValue::list();
        for (const StageTimes& stage : stages_) {
            JsonValue line;
            line.add("stage", stage.name)
                .add("median_ms", percentile(stage.ms, 50))
                .add("p10_ms", percentile(stage.ms, 10))
                .add("p90_ms", percentile(stage.ms, 90))
                .add("repetitions", static_cast<int>(stage.ms.size()));
            if (const double floor = floor_ms ? floor_ms(stage.name) : 0; floor > 0)
                line.add("floor_ms", floor).add("ratio", percentile(stage.ms, 50) / floor);
            list.items.push_back(line);
        }
        return list;
    }
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

/// Writes lines of JSON to standard output, and to the file `out` unless that is empty.
inline void put_lines(const std::string& lines, const std::string& out) {
    std::fputs(lines.c_str(), stdout);
    if (!out.empty()) write_text_file(out, lines), spdlog::info("Results: {}", out);
}

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
