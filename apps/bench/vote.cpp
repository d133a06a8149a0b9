#include <cstdio>
#include <memory>
#include <string_view>

#include "apps/bench/case.h"
#include "apps/bench/cloud.h"
#include "apps/bench/subcommands.h"
#include "apps/common/key_flags.h"
#include "core/device/device_choice.h"
#include "core/device/threads.h"
#include "pipeline/run/run_options.h"

namespace tvsgs {
namespace {

struct VoteArguments {
    std::vector<std::string> cases;
    std::string device = "auto", shape = "sphere", out;
    int synthetic = 0, repetitions = 20, warm_up = 3;
    std::uint64_t seed = 1;
    Configuration configuration;
    KeyFlags flags;

    explicit VoteArguments(CLI::App& app) : flags(app, configuration.table) {}
    /// The options of voting.
    const TvOptions& tv() {
        flags.set_all(configuration.table);
        return configuration.options.train.tv;
    }
};

constexpr std::string_view kRebuildStages[] = {"keys", "tree", "search", "reverse"};

bool is_rebuild(const std::string& stage) {
    return std::ranges::find(kRebuildStages, stage) != std::end(kRebuildStages);
}

struct Measured {
    Timings timings;
    JsonValue counters, memory;
};

/// Waits for the device: copies to the host do.
template <class Device>
void wait(const TensorField<Device>& field, Buffer<std::uint8_t, Device>& fence) {
    if (field.flags.empty()) return;
    fence.resize(1);
    to_host(fence);
}

void add_in_degrees(const std::vector<std::int64_t>& begin, JsonValue& counters) {
    std::vector<double> degrees;
    std::int64_t unheard = 0;
    double sum = 0;
    for (std::size_t i = 0; i + 1 < begin.size(); ++i) {
        const std::int64_t degree = begin[i + 1] - begin[i];
        degrees.push_back(static_cast<double>(degree));
        sum += degrees.back();
        unheard += degree == 0;
    }
    const double count = static_cast<double>(std::max<std::size_t>(degrees.size(), 1));
    counters.add("in_degree_mean", sum / count)
        .add("in_degree_p99", percentile(degrees, 99))
        .add("in_degree_max", percentile(degrees, 100))
        .add("in_degree_zero", unheard);
}

/// Times of events with and without a rebuild, first as in training, then with a wait around every
/// stage.
template <class Device>
Measured measure(const Gaussians<Cpu>& cloud,
                 const TvOptions& options,
                 int warm_up,
                 int repetitions) {
    Gaussians<Device> splats;
    copy(cloud, splats);
    const std::int64_t before = memory_use(Device{}).current_bytes;
    TensorVoter<Device> voter(options);
    TensorField<Device> field;
    Buffer<std::uint8_t, Device> fence;
    Measured out;
    int step = options.start;
    const auto event = [&](bool rebuild) {
        if (rebuild) step += options.refresh_every;  // else the lists hold
        const Stopwatch watch;
        voter.vote(step, splats, field);
        wait(field, fence);
        return watch.ms();
    };
    for (int i = 0; i < std::max(warm_up, 1); ++i) event(true), event(false);
    for (int i = 0; i < repetitions; ++i) {
        out.timings.add("rebuild and event", event(true));
        out.timings.add("event", event(false));
    }
    const std::int64_t after = memory_use(Device{}).current_bytes;
    voter.set_profiling(true);
    VotingProfile profile;
    for (int i = 0; i < repetitions; ++i) {
        event(true);
        profile = voter.profile();
        double rebuild = 0, round = 0;
        for (const StageTime& stage : profile.stages) {
            const double ms = 1e3 * stage.seconds;
            out.timings.add(stage.name, ms);
            (is_rebuild(stage.name) ? rebuild : round) += ms;
        }
        out.timings.add("rebuild, sum of stages", rebuild);
        out.timings.add("event, sum of stages", round);
    }
    out.memory.add("voter_bytes", profile.bytes);
    add_in_degrees(voter.details().begin, out.counters);
    out.memory.add("voter_and_field_bytes", after - before)
        .add("peak_bytes", memory_use(Device{}).peak_bytes);
    return out;
}

std::string comparison_json(const VotingCase& c,
                            const CaseComparison& result,
                            const std::string& device) {
    JsonValue json;
    json.add("case", c.name)
        .add("version", kVersion)
        .add("device", device)
        .add("precision",
             c.options.precision == VotePrecision::single_precision ? "single" : "double")
        .add("splats", c.size())
        .add("k", c.k);
    JsonValue quantities = JsonValue::object();
    for (const CaseQuantity& q : result.quantities)
        quantities.add(q.name, JsonValue()
                                   .add("largest", q.largest)
                                   .add("bound", q.bound)
                                   .add("at", q.at)
                                   .add("defined", q.defined)
                                   .add("compared", q.compared)
                                   .add("excused", q.excused));
    json.add("quantities", quantities)
        .add("lists_with_ties", result.lists_with_ties)
        .add("excused", result.excused);
    json.add("met", result.faults().empty());
    return json_text(json);
}

int compare_cases(VoteArguments& a) {
    const DeviceChoice device = choose_device(a.device);
    const TvOptions& tv = a.tv();
    bool all_met = true;
    std::string lines;
    for (const std::string& path : a.cases) {
        VotingCase stored = read_voting_case(path);
        stored.options.lists = tv.lists, stored.options.precision = tv.precision;
        const CaseComparison result =
            on_device(device, [&](auto tag) { return compare_case_on(stored, tag); });
        for (const std::string& fault : result.faults()) {
            all_met = false;
            spdlog::error("{}: {} (on {})", path, fault, device.description);
        }
        lines += comparison_json(stored, result, device.description) + "\n";
    }
    put_lines(lines, a.out);
    return static_cast<int>(all_met ? ExitCode::done : ExitCode::bound);
}

int time_synthetic(VoteArguments& a) {
    const TvOptions& tv = a.tv();
    const DeviceChoice device = choose_device(a.device);
    const Gaussians<Cpu> cloud = make_bench_cloud(a.shape, a.synthetic, a.seed);
    const Measured m = on_device(device, [&](auto tag) {
        return measure<decltype(tag)>(cloud, tv, a.warm_up, a.repetitions);
    });
    if (!is_quiet()) {
        std::fprintf(stderr, "%s, %d splats, k %d, %s\n", a.shape.c_str(), a.synthetic, tv.k,
                     device.description.c_str());
        m.timings.print();
        std::fprintf(stderr, "  counters %s\n  memory   %s\n", json_text(m.counters).c_str(),
                     json_text(m.memory).c_str());
    }
    JsonValue json;
    json.add("bench", "vote")
        .add("version", kVersion)
        .add("device", device.description)
        .add("threads", thread_count())
        .add("shape", a.shape)
        .add("splats", a.synthetic)
        .add("seed", a.seed)
        .add("k", tv.k)
        .add("rebuild_ms", m.timings.median("rebuild, sum of stages"))
        .add("event_ms", m.timings.median("event"))
        .add("stages", m.timings.json())
        .add("counters", m.counters)
        .add("memory", m.memory);
    put_lines(json_text(json) + "\n", a.out);
    return 0;
}

}  // namespace

Subcommand add_bench_vote(CLI::App& app) {
    CLI::App& c = *app.add_subcommand("vote", "test and time tensor voting");
    const auto a = std::make_shared<VoteArguments>(c);
    add_repeated(c, "--case", a->cases,
                 "compare with a case of the oracle (.npz); exit code 8 beyond the bounds");
    add_number(c, "--synthetic", a->synthetic, 1, 100'000'000,
               "time rebuild and event on N synthetic splats");
    add_choice(c, "--shape", a->shape, bench_shapes(), "shape of the synthetic splats");
    c.add_option("--seed", a->seed, "seed of the synthetic splats");
    add_number(c, "--repetitions", a->repetitions, 1, 100'000, "timed repetitions");
    add_number(c, "--warm-up", a->warm_up, 1, 100'000, "repetitions before the timed ones");
    a->flags.add_config("JSON configuration; only tv.* is used");
    c.add_option("--device", a->device, "auto, cpu, cuda or cuda:N");
    add_output_flag(c, "--out", a->out, "JSON file for the results, too");
    return {&c, [a] {
                if (a->cases.empty() == (a->synthetic == 0))
                    throw usage_error("give either --case or --synthetic");
                return a->cases.empty() ? time_synthetic(*a) : compare_cases(*a);
            }};
}

}  // namespace tvsgs
