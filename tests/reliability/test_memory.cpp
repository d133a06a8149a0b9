// Memory: what is estimated, where growth stops, and how it ends when there is none.
#include <sys/resource.h>

#include "command_test.h"
#include "core/device/buffer.h"
#include "core/error.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

#ifndef __has_feature  // clang's way to say it
#define __has_feature(x) 0
#endif
#if defined(__SANITIZE_ADDRESS__) || __has_feature(address_sanitizer)
constexpr bool kOwnAllocator = true;  // takes terabytes of addresses, and more memory for each byte
#else
constexpr bool kOwnAllocator = false;
#endif

/// A limit that does not outlive the test.
struct Limit {
    explicit Limit(std::int64_t bytes) { set_memory_limit(Cpu{}, bytes); }
    ~Limit() { set_memory_limit(Cpu{}, INT64_MAX); }
};

void expect_told(const Error& error, const std::string& needed, const std::string& there) {
    const std::string what = error.what();
    EXPECT_EQ(error.code(), ExitCode::memory);
    for (const std::string& part : {needed, there, std::string("--max-gaussians"),
                                    std::string("-r"), std::string("tv.lists=compact")})
        EXPECT_NE(what.find(part), std::string::npos) << "'" << part << "' is not in: " << what;
}

TEST(Allocation, FailsWithWhatWasNeededAndThereAndThreeRemedies) {
    Buffer<float, Cpu> held(1 << 20);
    {
        const Limit limit(memory_use(Cpu{}).current_bytes + (1 << 20));
        Buffer<float, Cpu> other(100);
        try {
            other.resize(1 << 19);
            ADD_FAILURE() << "2 MiB where 1 MiB is allowed";
        } catch (const Error& error) {
            expect_told(error, "2,621,440 more bytes", "MiB (memory.host)");  // a quarter to spare
        }
        EXPECT_TRUE(other.empty()) << "nothing that was lost can be indexed";
        other.resize(1 << 17);  // half a MiB is there
    }
    if (kOwnAllocator) return;
    try {
        Buffer<std::byte, Cpu> all(std::size_t{1} << 60);
        ADD_FAILURE() << "an exabyte";
    } catch (const Error& error) {
        expect_told(error, "1,152,921,504,606,846,976 more bytes", "none left on this machine");
    }
    EXPECT_LT(memory_use(Cpu{}).current_bytes, 1 << 30) << "what failed is not counted";
}

class Memory : public CommandTest {
protected:
    static json plan(const std::string& run) { return json::parse(read(run + "/memory.json")); }
    static std::int64_t at(const json& need, std::int64_t splats) {
        return need.at("fixed_bytes").get<std::int64_t>() +
               need.at("bytes_per_splat").get<std::int64_t>() * splats;
    }
    static std::vector<json> log(const std::string& run) {
        std::istringstream text(read(run + "/log.jsonl"));
        std::vector<json> lines;
        for (std::string line; std::getline(text, line);) lines.push_back(json::parse(line));
        return lines;
    }
    static std::int64_t most_splats(const std::string& run) {
        std::int64_t most = 0;
        for (const json& line : log(run)) most = std::max(most, line.value("gaussians", most));
        return most;
    }
    static constexpr const char* kGrowth =
        "--set plan.enabled=false --scene scene --views 0,1,2 --set densify.from=2 --set "
        "densify.every=4 --set "
        "densify.gradient_threshold=0 --set densify.max_per_pixel=0 --report-every 1 ";
};

TEST_F(Memory, EstimatesAreNearTheMeasuredPeak) {
    for (const std::string config : {"3dgs", "pgsr_sparse", "pgsr_dense", "2dgs", "rade_gs"})
        for (const bool grows : {false, true}) {
            const std::string run = config + (grows ? "_grows" : "");
            const Result r = train(
                (grows ? std::string(kGrowth) + "--iterations 10 --set densify.until=9 "
                       : "--scene scene --views 0,1,2 --set densify.enabled=false ") +
                "--checkpoint-every 4 --config " TVSGS_SOURCE_DIR "/configs/" + config +
                ".json --set loss.multi_view_ncc.start=1 --set loss.multi_view_geometry.start=1 "
                "--set loss.normal.start=1 --set init.min_points=0 --out " +
                run);
            ASSERT_EQ(r.code, 0) << r;
            EXPECT_TRUE(r.says(" of memory, ")) << "told before the first step: " << r;
            const auto peak = last_line(run).at("peak_bytes").get<double>();
            const auto estimate = static_cast<double>(at(plan(run).at("device"), most_splats(run)));
            // Never too little. Too much, as lists of tiles vary with the view, buffers grow by
            // quarters, and two checkpoints are counted where short runs hold one.
            EXPECT_LT(estimate, 2 * peak) << run;
            EXPECT_GT(estimate, peak) << run;
        }
}

TEST_F(Memory, GrowthStopsAtWhatFits) {
    const Result free = train(std::string(kGrowth) + "--iterations 10 --out free");
    ASSERT_EQ(free.code, 0) << free;
    const json need = plan("free").at("host");
    const std::int64_t first = plan("free").at("first_splats");
    ASSERT_GT(most_splats("free"), 2 * first) << "or the caps below are none";

    const Result pixels = train(std::string(kGrowth) +
                                "--iterations 10 --set densify.max_per_pixel=0.9 --out pixels");
    ASSERT_EQ(pixels.code, 0) << pixels;
    const auto all = plan("pixels").at("most_splats").get<std::int64_t>();
    EXPECT_LT(all, most_splats("free"));
    EXPECT_LE(most_splats("pixels"), all);

    const std::int64_t cap = first + first / 2;
    const std::string most = std::to_string(cap);
    ASSERT_EQ(
        train(std::string(kGrowth) + "--iterations 10 --out capped --max-gaussians " + most).code,
        0);
    EXPECT_LE(most_splats("capped"), cap);
    EXPECT_GT(most_splats("capped"), first) << "stops there, not before";

    // The same number of splats by a limit in bytes, on this device the host's; and a run that goes
    // on has the same.
    const std::string limit = "--host-memory " + std::to_string(at(need, cap)) + " ";
    ASSERT_EQ(train(std::string(kGrowth) + limit + "--iterations 10 --out limited").code, 0);
    EXPECT_EQ(plan("limited").at("most_splats"), cap);
    EXPECT_TRUE(splats("limited", 10) == splats("capped", 10));
    EXPECT_LE(last_line("limited").at("peak_bytes").get<std::int64_t>(), at(need, cap));
    ASSERT_EQ(train(std::string(kGrowth) + limit + "--iterations 7 --out halves").code, 0);
    ASSERT_EQ(train("--resume halves --iterations 10 --report-every 1").code, 0);
    EXPECT_TRUE(splats("halves", 10) == splats("limited", 10));
}

TEST_F(Memory, TheFirstSplatsMustFit) {
    expect_refused("--scene scene --views 0,1 --host-memory 33M", 4, "training needs about ");
    expect_refused("--scene scene --views 0,1 --host-memory 33M", 4, " MiB may be used");
    expect_refused("--scene scene --views 0,1 --host-memory 33M", 4, "--max-gaussians");
    // Half of the splats fit: three blocks, with their margins. The images alone do not: no blocks.
    const std::string compact = "--scene scene --views 0,1 --iterations 1 --set tv.lists=compact ";
    const Result whole = train(compact + "--out whole");
    ASSERT_EQ(whole.code, 0) << whole;
    const std::int64_t half =
        at(plan("whole").at("host"), plan("whole").at("first_splats").get<std::int64_t>() / 2);
    expect_refused(
        compact + "--host-memory " + std::to_string(half), 4,
        "make blocks that fit: tvsgs-blocks split --scene scene --blocks 3 --out BLOCKS");
    const Result none = train(compact + "--host-memory 1M --out none");
    EXPECT_EQ(none.code, 4) << none;
    EXPECT_FALSE(none.says("tvsgs-blocks")) << none;
    for (const char* wrong : {"0", "-1G", "8Q", "lots", "nan", "1e"})
        expect_refused(std::string("--scene scene --views 0,1 --host-memory=") + wrong, 2,
                       "expected a size in bytes, such as 8G or 500M");
    expect_refused("--scene scene --views 0,1 --gpu-memory 8Q", 2, "memory.gpu");
}

TEST_F(Memory, WhenTheHostHasNoMoreTheRunEndsWithItsCheckpoint) {
    if (kOwnAllocator) GTEST_SKIP() << "the sanitizer's own memory does not fit under a limit";
    // Addresses end where a small machine would: late enough to start, too early for all the
    // splats.
    const std::string arguments =
        std::string(kGrowth) +
        "--set init.min_points=0 --device cpu --iterations 400 "
        "--checkpoint-every 3 --set densify.every=3 --set densify.min_opacity=0 --set "
        "densify.trim_min_views=0 --out ended";
    const Result r =
        shell("ulimit -v 250000; OMP_NUM_THREADS=1 timeout 120 " TVSGS_BIN_DIR "/tvsgs-train " +
              arguments + " >out.txt 2>err.txt");
    EXPECT_EQ(r.code, 4) << r;
    EXPECT_TRUE(r.says("out of memory: ")) << r;
    EXPECT_TRUE(r.says("--max-gaussians")) << r;
    EXPECT_TRUE(r.says("the last checkpoint is ended/checkpoints/iteration_")) << r;
    for (const auto& file : fs::recursive_directory_iterator(folder_ / "ended"))
        EXPECT_EQ(file.path().string().find(".tmp-"), std::string::npos) << file.path();
}

TEST_F(Memory, PhotographsInAFileTakeNoneOfIt) {
    if (kOwnAllocator) GTEST_SKIP() << "the sanitizer's own memory does not fit under a limit";
    // Eight of 2400 x 1800 pixels: 138 MB with their masks.
    const auto plan_within = [](const std::string& place) {
        return shell("ulimit -d 120000; OMP_NUM_THREADS=1 " TVSGS_BIN_DIR
                     "/tvsgs-train --device cpu --scene scene -r 2400 --plan --set "
                     "scene.photos=" +
                     place + " --set init.min_points=0 --out none >out.txt 2>err.txt");
    };
    const Result file = plan_within("file"), memory = plan_within("memory");
    EXPECT_EQ(file.code, 0) << file;
    EXPECT_TRUE(file.says("Photographs are kept in a file in ")) << file;
    EXPECT_EQ(memory.code, 4) << memory;
}

TEST_F(Memory, PhotographsInAFileGiveTheSameBits) {
    for (const std::string config : {"pgsr_sparse", "pgsr_dense"})
        for (const std::string place : {"file", "memory"})
            expect_trained("--scene scene --views 0,1,2,3,4,5,6 --config " TVSGS_SOURCE_DIR
                           "/configs/" +
                               config +
                               ".json --set loss.photometric.masks=object --set "
                               "loss.multi_view_ncc.start=1 --set loss.multi_view.limits=relative "
                               "--set scene.photos=" +
                               place,
                           config + "_" + place);
    for (const std::string config : {"pgsr_sparse", "pgsr_dense"})
        EXPECT_TRUE(splats(config + "_file") == splats(config + "_memory")) << config;
    EXPECT_EQ(plan("pgsr_sparse_memory").at("host").at("fixed_bytes").get<std::int64_t>() >
                  plan("pgsr_sparse_file").at("host").at("fixed_bytes").get<std::int64_t>(),
              true);
}

TEST(Allocation, OnTheGpu) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        try {
            Buffer<std::byte, Cuda> all(std::size_t{1} << 50);
            ADD_FAILURE() << "a petabyte";
        } catch (const Error& error) {
            expect_told(error, "GPU memory: 1,125,899,906,842,624 more bytes", "MiB free");
        }
        set_memory_limit(Cuda{}, memory_use(Cuda{}).current_bytes + 1000);
        try {
            Buffer<std::byte, Cuda> more(1001);
            ADD_FAILURE() << "beyond the limit";
        } catch (const Error& error) {
            expect_told(error, "GPU memory: 1,001 more bytes", "MiB (--gpu-memory)");
        }
        set_memory_limit(Cuda{}, INT64_MAX);
        EXPECT_NO_THROW((Buffer<std::byte, Cuda>(1 << 20)));
    }
}

}  // namespace
}  // namespace tvsgs
