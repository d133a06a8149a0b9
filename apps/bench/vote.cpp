#include "apps/bench/vote.h"

#include <cmath>
#include <cstdio>
#include <string_view>

#include "apps/bench/case.h"
#include "apps/bench/cloud.h"
#include "apps/bench/stats.h"
#include "core/device/device_choice.h"
#include "core/device/threads.h"
#include "io/files/atomic_file.h"
#include "pipeline/run/run_options.h"

namespace tvsgs {
namespace {

/// Keys that trade memory or time against precision; --errors tries all their values.
constexpr std::string_view kTradeKeys[] = {"tv.lists", "tv.precision"};

constexpr std::string_view kRebuildStages[] = {"keys", "tree", "search", "reverse"};

bool is_rebuild(const std::string& stage) {
    return std::find(std::begin(kRebuildStages), std::end(kRebuildStages), stage) !=
           std::end(kRebuildStages);
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
        for (const VotingStage& stage : profile.stages) {
            out.timings.add(stage.name, stage.ms);
            (is_rebuild(stage.name) ? rebuild : round) += stage.ms;
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

/// Angles to the reference's normals after two events, where its eigenvalue gap allows.
template <class Device>
JsonValue normal_errors(const Gaussians<Cpu>& cloud,
                        const TvOptions& options,
                        const FieldOnHost& reference) {
    Gaussians<Device> splats;
    copy(cloud, splats);
    const FieldOnHost field = run_events(splats, options, 2);
    std::vector<double> angles;
    std::int64_t not_finite = 0;
    for (std::size_t i = 0; i < field.normals.size(); ++i) {
        if ((reference.flags[i] & kHasTensor) == 0 ||
            !(relative_gap(reference.eigenvalues[i]) > kComparedGap))
            continue;
        const double angle = angle_deg(field.normals[i], reference.normals[i]);
        if (angle * 0 == 0)
            angles.push_back(angle);
        else
            ++not_finite;
    }
    JsonValue json;
    json.add("compared", angles.size())
        .add("not_finite", not_finite)
        .add("median_deg", percentile(angles, 50))
        .add("p90_deg", percentile(angles, 90))
        .add("p99_deg", percentile(angles, 99))
        .add("max_deg", percentile(angles, 100));
    return json;
}

bool is_trade(const Option& option) {
    return std::find(std::begin(kTradeKeys), std::end(kTradeKeys), option.key) !=
           std::end(kTradeKeys);
}

/// Of `from` what the rules of a stored case leave open.
void take_trades(TvOptions from, TvOptions& to) {
    OptionTable source, target;
    source.add("tv", from), target.add("tv", to);
    for (const Option& option : source.options())
        if (is_trade(option)) target.set(option.key, option.get(), "tvsgs-bench");
}

RunOptions run_options(const std::vector<std::string>& configs,
                       const std::vector<std::string>& settings) {
    RunOptions run;
    OptionTable table;
    run.add_to(table);
    for (const std::string& path : configs) table.read_file(path);
    table.set_all(settings);
    return run;
}

/// The configured options, or one entry for every combination of the values of kTradeKeys.
struct Choice {
    std::string name;
    TvOptions options;
};
std::vector<Choice> choices(RunOptions& run, bool all) {
    OptionTable table;
    run.add_to(table);
    std::vector<Choice> list = {{"", run.train.tv}};
    for (const Option& option : table.options()) {
        if (!is_trade(option)) continue;
        std::vector<Choice> longer;
        for (const Choice& shorter : list)
            for (const std::string& value :
                 all ? option.choices : std::vector<std::string>{option.get()}) {
                run.train.tv = shorter.options;
                table.set(option.key, value, "tvsgs-bench");
                longer.push_back(
                    {str(shorter.name, shorter.name.empty() ? "" : " ", option.key, "=", value),
                     run.train.tv});
            }
        list = longer;
    }
    return list;
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
    if (!result.not_stored.empty()) json.add("not_stored", result.not_stored);
    json.add("met", result.faults().empty());
    return json_text(json);
}

}  // namespace

VoteBench::VoteBench(CLI::App& app)
    : command_(app.add_subcommand("vote", "test and time tensor voting")) {
    CLI::App& c = *command_;
    c.add_option("--case", cases_,
                 "compare with a case of the oracle (.npz); exit code 8 beyond the bounds")
        ->expected(1)
        ->take_all();
    c.add_option("--synthetic", synthetic_, "time rebuild and event on N synthetic splats")
        ->check(CLI::Range(1, 100'000'000));
    c.add_option("--shape", shape_, "shape of the synthetic splats")
        ->check(CLI::IsMember(bench_shapes()))
        ->capture_default_str();
    c.add_option("--seed", seed_, "seed of the synthetic splats")->capture_default_str();
    c.add_option("--repetitions", repetitions_, "timed repetitions")
        ->check(CLI::Range(1, 100'000))
        ->capture_default_str();
    c.add_option("--warm-up", warm_up_, "repetitions before the timed ones")
        ->check(CLI::Range(1, 100'000))
        ->capture_default_str();
    c.add_flag("--errors", errors_,
               "also measure the angles to the normals of the reference in double, for each form "
               "of the lists");
    c.add_option("-c,--config", configs_, "JSON configuration; only tv.* is used")
        ->expected(1)
        ->take_all();
    c.add_option("--set", settings_, "a key of tv, such as tv.k=64")->expected(1)->take_all();
    c.add_option("--device", device_, "auto, cpu, cuda or cuda:N")->capture_default_str();
    add_output_flag(c, "--out", out_, "JSON file for the results, too");
    c.add_flag("--quiet", quiet_, "warnings and errors only");
}

int VoteBench::run() const {
    if (cases_.empty() == (synthetic_ == 0))
        throw Error(ExitCode::usage, "give either --case or --synthetic");
    return cases_.empty() ? time_synthetic() : compare_cases();
}

int VoteBench::compare_cases() const {
    const DeviceChoice device = choose_device(device_);
    const RunOptions run = run_options(configs_, settings_);
    bool all_met = true;
    std::string lines;
    for (const std::string& path : cases_) {
        VotingCase stored = read_voting_case(path);
        take_trades(run.train.tv, stored.options);
        const CaseComparison result =
            on_device(device, [&](auto tag) { return compare_case_on(stored, tag); });
        for (const std::string& fault : result.faults()) {
            all_met = false;
            spdlog::error("{}: {} (on {})", path, fault, device.description);
        }
        const std::string line = comparison_json(stored, result, device.description) + "\n";
        std::fputs(line.c_str(), stdout);
        lines += line;
    }
    if (!out_.empty()) write_text_file(out_, lines), spdlog::info("Results: {}", out_);
    return static_cast<int>(all_met ? ExitCode::done : ExitCode::bound);
}

int VoteBench::time_synthetic() const {
    RunOptions run = run_options(configs_, settings_);
    const DeviceChoice device = choose_device(device_);
    const Gaussians<Cpu> cloud = make_bench_cloud(shape_, synthetic_, seed_);
    FieldOnHost reference;
    if (errors_) {
        TvOptions exact = run.train.tv;
        exact.precision = VotePrecision::double_precision;
        reference = run_events(cloud, exact, 2);
    }

    JsonValue json, results = JsonValue::list();
    for (const Choice& choice : choices(run, errors_)) {
        JsonValue result;
        result.add("choice", choice.name);
        const Measured m = on_device(device, [&](auto tag) {
            using Device = decltype(tag);
            if (errors_)
                result.add("normal_error", normal_errors<Device>(cloud, choice.options, reference));
            return measure<Device>(cloud, choice.options, warm_up_, repetitions_);
        });
        result.add("rebuild_ms", m.timings.median("rebuild, sum of stages"))
            .add("event_ms", m.timings.median("event"))
            .add("stages", m.timings.json())
            .add("counters", m.counters)
            .add("memory", m.memory);
        results.items.push_back(result);
        if (quiet_) continue;
        std::fprintf(stderr, "%s, %d splats, k %d, %s%s%s\n", shape_.c_str(), synthetic_,
                     choice.options.k, device.description.c_str(), choice.name.empty() ? "" : ", ",
                     choice.name.c_str());
        m.timings.print();
        std::fprintf(stderr, "  counters %s\n  memory   %s\n", json_text(m.counters).c_str(),
                     json_text(m.memory).c_str());
    }
    json.add("bench", "vote")
        .add("version", kVersion)
        .add("device", device.description)
        .add("threads", thread_count())
        .add("shape", shape_)
        .add("splats", synthetic_)
        .add("seed", seed_)
        .add("k", run.train.tv.k)
        .add("results", results);
    std::printf("%s\n", json_text(json).c_str());
    if (!out_.empty())
        write_text_file(out_, json_text(json) + "\n"), spdlog::info("Results: {}", out_);
    return static_cast<int>(ExitCode::done);
}

}  // namespace tvsgs
