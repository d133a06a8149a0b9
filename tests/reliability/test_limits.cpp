// Options, streams and counts at their limits.
#include <sys/stat.h>

#include "command_test.h"
#include "core/error.h"
#include "render/tiles/tiles.h"

namespace tvsgs {
namespace {

class Limits : public CommandTest {};

TEST_F(Limits, NumbersThatDoNotFit) {
    for (const char* option :
         {"--max-gaussians 99999999999999999999", "--iterations 2147483648", "--iterations 1e400",
          "--seed 99999999999999999999999", "--set densify.max_gaussians=-1", "--set lr.scale=1e39",
          "--set lr.scale=nan", "--set tv.k=3.5", "--checkpoint-every 99999999999999",
          "--report-every 0", "--views 0,99999999999999999999", "--num-views -3", "-r 99999999"}) {
        const Result r =
            call("train", std::string("--device cpu --scene scene --out refused ") + option);
        EXPECT_EQ(r.code, 2) << option << ": " << r;
        EXPECT_GT(r.err.size(), 30u) << "says what was expected: " << r;
        EXPECT_FALSE(fs::exists(folder_ / "refused")) << option;
    }
    for (const char* arguments :
         {"synth --out s --views 99999999999", "synth --out s --width 0",
          "eval geometry --pred a --gt b --point-samples 1e30",
          "extract-mesh --model a --clusters -1", "init --scene scene --max-points -2"}) {
        const std::string text = arguments;
        const Result r = call(text.substr(0, text.find(' ')), text.substr(text.find(' ')));
        EXPECT_EQ(r.code, 2) << arguments << ": " << r;
    }
    EXPECT_FALSE(fs::exists(folder_ / "s"));
}

TEST_F(Limits, OptionsThatContradictEachOther) {
    expect_refused("--scene scene --split train_3 --eval", 2, "exclude each other");
    expect_refused("--scene scene --quiet --verbose", 2, "--quiet");
    expect_refused("--scene scene --set tv.enabled=false --set loss.tv_normal.weight=1", 2,
                   "tv.enabled is false but");
    expect_refused("--scene scene --views 0,1 --views 9999", 2, "expected 0 to 7");
    write("twice.json", "{\"tv\": {\"k\": 3, \"k\": 4}}");
    expect_refused("--scene scene --config twice.json", 2, "is given twice");
}

TEST_F(Limits, StandardOutputThatIsClosedOrFull) {
    const std::string list = TVSGS_BIN_DIR "/tvsgs-train --list-keys";
    const Result enough = shell(list + " 2>err.txt | head -1 >out.txt; test ${PIPESTATUS:-0} = 0");
    EXPECT_EQ(enough.code, 0) << enough;
    EXPECT_FALSE(enough.out.empty());
    EXPECT_TRUE(enough.err.empty()) << enough << "; a reader that has enough is no error";
    EXPECT_EQ(shell(list + " >&- 2>err.txt").code, 0);
    const Result full = shell(list + " >/dev/full 2>err.txt");
    EXPECT_EQ(full.code, 6) << full;
    EXPECT_TRUE(full.says("cannot write to standard output")) << full;

    // Messages that nobody reads do not stop a training, nor do they get into its files.
    const std::string train = TVSGS_BIN_DIR
        "/tvsgs-train --device cpu --iterations 6 --set init.min_points=0 --scene scene --views "
        "0,1,2 --progress json --report-every 1 --out ";
    EXPECT_EQ(shell("(" + train + "unread; echo $? >code.txt) 2>&1 | head -1 >out.txt").code, 0);
    EXPECT_EQ(read("code.txt"), "0\n");
    EXPECT_EQ(last_line("unread").at("event"), "done");
    EXPECT_EQ(shell(train + "closed 2>&- >&- <&-").code, 0);
    EXPECT_TRUE(splats("closed") == splats("unread"));
}

TEST_F(Limits, NoGpuThatMayBeUsed) {
    // Also on a machine that has some, and with a build without CUDA.
    const std::string hidden = "CUDA_VISIBLE_DEVICES= " TVSGS_BIN_DIR
                               "/tvsgs-train --scene scene --views 0,1 --iterations 1 --set "
                               "init.min_points=0 --out hidden ";
    for (const char* device : {"cuda", "cuda:0", "cuda:7"}) {
        const Result r = shell(hidden + "--device " + device + " >out.txt 2>err.txt");
        EXPECT_EQ(r.code, 5) << r;
        EXPECT_TRUE(r.says("--device cpu")) << r;
        EXPECT_FALSE(fs::exists(folder_ / "hidden"));
    }
    EXPECT_EQ(shell(hidden + ">out.txt 2>err.txt").code, 0) << "auto";
}

TEST_F(Limits, OutputFoldersThatCannotBeUsed) {
    if (::geteuid() != 0) {  // root may write anywhere
        fs::create_directories(folder_ / "locked");
        ::chmod((folder_ / "locked").c_str(), 0500);
        const Result r = train("--scene scene --views 0,1 --out locked/run");
        EXPECT_EQ(r.code, 6) << r;
        EXPECT_TRUE(r.says("choose another folder with --out")) << r;
        ::chmod((folder_ / "locked").c_str(), 0700);
    }
    const Result r = train("--scene scene --views 0,1 --out /proc/none/run");
    EXPECT_EQ(r.code, 6) << r;
    EXPECT_TRUE(r.says("/proc/none/run: cannot write there")) << r;
}

TEST(Fragments, MoreThanTheIndexHoldsAreRefused) {
    EXPECT_NO_THROW(check_fragment_count(kMaxFragments));
    for (const std::uint64_t count :
         {kMaxFragments + 1, std::uint64_t{1} << 33, ~std::uint64_t{0}}) {
        try {
            check_fragment_count(count);
            ADD_FAILURE() << count;
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::memory);
            EXPECT_NE(std::string(error.what()).find("--max-gaussians"), std::string::npos);
        }
    }
}

}  // namespace
}  // namespace tvsgs
