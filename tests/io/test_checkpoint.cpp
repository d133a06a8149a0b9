// Tests checkpoint files: the data survive a round trip, and every damage is detected.
#include <gtest/gtest.h>
#include <sys/inotify.h>
#include <sys/resource.h>
#include <unistd.h>

#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "core/error.h"
#include "io/files/checkpoint.h"
#include "io/files/manifest.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

class CheckpointFile : public testing::Test {
protected:
    void SetUp() override {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_checkpoint_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
        path_ = (folder_ / "a.ckpt").string();
    }
    void TearDown() override { fs::remove_all(folder_); }

    static void fill(State& state, const char* name, std::size_t floats) {
        StateArray& array = state.add(name, 12, floats / 3, true);
        for (std::size_t i = 0; i < floats; ++i) {
            const float value = static_cast<float>(i) * 0.25f - 3;
            std::memcpy(array.bytes.data() + 4 * i, &value, 4);
        }
    }
    void save(const std::string& bytes) const {
        std::ofstream(path_, std::ios::binary | std::ios::trunc) << bytes;
    }
    std::string error() const {
        try {
            read_checkpoint(path_);
        } catch (const Error& e) {
            EXPECT_EQ(e.code(), ExitCode::input);
            return e.what();
        }
        return "";
    }

    fs::path folder_;
    std::string path_;
};

TEST_F(CheckpointFile, ComesBack) {
    State a, b;
    fill(a, "means", 30);
    a.add("empty", 4, 0, true);
    auto& flags = b.add("flags", 1, 5, false).bytes;
    std::memset(flags.data(), 9, flags.size());
    write_checkpoint(path_, {&a, &b});
    const State read = read_checkpoint(path_);
    ASSERT_EQ(read.arrays.size(), 3u);
    EXPECT_EQ(std::memcmp(read.get("means", 12).bytes.data(), a.arrays[0].bytes.data(), 120), 0);
    EXPECT_TRUE(read.get("means", 12).real);
    EXPECT_EQ(read.get("empty", 4).count(), 0u);
    EXPECT_EQ(read.get("flags", 1).bytes[4], std::byte{9});
    EXPECT_FALSE(read.get("flags", 1).real);
    EXPECT_EQ(read.find("tensors"), nullptr);
    EXPECT_THROW(read.get("means", 16), Error);
}

TEST_F(CheckpointFile, DamageOfEveryByteAndEveryCutAreFound) {
    State state;
    fill(state, "means", 30);
    fill(state, "quats", 3);
    write_checkpoint(path_, {&state});
    const std::string good = read_bytes(path_);
    for (std::size_t at = 0; at < good.size(); ++at) {
        std::string bad = good;
        bad[at] = static_cast<char>(bad[at] ^ (1 << at % 8));
        save(bad);
        EXPECT_NE(error().find(path_), std::string::npos) << "byte " << at;
    }
    for (std::size_t length = 0; length < good.size(); ++length) {
        save(good.substr(0, length));
        EXPECT_NE(error(), "") << "cut to " << length;
    }
    save(good + "x");
    EXPECT_NE(error().find("damaged"), std::string::npos);
    save(good);
    EXPECT_EQ(error(), "");
}

TEST_F(CheckpointFile, OtherFilesAndVersions) {
    EXPECT_NE(error().find("cannot open it"), std::string::npos);
    save("ply\nformat ascii 1.0\nelement vertex 0\nend_header\n");
    EXPECT_NE(error().find("not a checkpoint"), std::string::npos);
    State state;
    fill(state, "means", 3);
    fs::remove(path_);
    write_checkpoint(path_, {&state});
    std::string other = read_bytes(path_);
    other[8] = 0;
    save(other);
    EXPECT_NE(error().find("version 0, or damaged; expected version 1"), std::string::npos);
    path_ = folder_.string();
    EXPECT_NE(error().find("is a folder"), std::string::npos);
}

// Simulates a full disk: writing fails in the middle of the file.
TEST_F(CheckpointFile, AFullDiskKeepsTheLastOne) {
    State small, large;
    fill(small, "means", 30);
    fill(large, "means", 300000);
    start_manifest(folder_);
    write_checkpoint(path_, {&small});
    rlimit before{};
    getrlimit(RLIMIT_FSIZE, &before);
    const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
    const rlimit less{100000, before.rlim_max};
    setrlimit(RLIMIT_FSIZE, &less);
    try {
        write_checkpoint(path_, {&large});
        ADD_FAILURE() << "no error";
    } catch (const Error& e) {
        EXPECT_EQ(e.code(), ExitCode::io);
        EXPECT_NE(std::string(e.what()).find(path_), std::string::npos);
    }
    setrlimit(RLIMIT_FSIZE, &before);
    std::signal(SIGXFSZ, old_handler);
    EXPECT_EQ(read_checkpoint(path_).get("means", 12).count(), 10u);
    EXPECT_EQ(std::distance(fs::directory_iterator(folder_), {}), 2) << "a temporary file is left";
}

// A run that is killed while its files are removed remains a run.
TEST_F(CheckpointFile, TheConfigurationOfAListIsRemovedLast) {
    const fs::path run = folder_ / "listed";
    fs::create_directories(run);
    start_manifest(run);
    for (const char* name : {"log.jsonl", "config.json", "memory.json"}) {
        add_to_manifest(run, run / name);
        std::ofstream(run / name) << name;
    }
    const int watch = inotify_init1(IN_NONBLOCK);
    ASSERT_GE(inotify_add_watch(watch, run.c_str(), IN_DELETE), 0);
    remove_listed_files(run);
    alignas(inotify_event) char events[4096];
    const ssize_t size = read(watch, events, sizeof events);
    close(watch);
    std::string removed;
    for (ssize_t at = 0; at < size;) {
        const auto* const event = reinterpret_cast<const inotify_event*>(events + at);
        removed += std::string(event->name) + " ";
        at += static_cast<ssize_t>(sizeof(inotify_event) + event->len);
    }
    EXPECT_EQ(removed, "log.jsonl memory.json config.json .tvsgs-files ");
}

TEST(State, NotFinite) {
    State state;
    StateArray& array = state.add("means", 12, 300000, true);
    std::memset(array.bytes.data(), 0, array.bytes.size());
    EXPECT_FALSE(find_not_finite(state));
    const float infinite = -INFINITY, none = NAN;
    std::memcpy(array.bytes.data() + 12 * 299999 + 8, &infinite, 4);
    EXPECT_EQ(find_not_finite(state)->element, 299999u);
    std::memcpy(array.bytes.data() + 12 * 100001, &none, 4);
    EXPECT_EQ(find_not_finite(state)->element, 100001u);
    EXPECT_EQ(find_not_finite(state)->array, "means");
    state.arrays[0].real = false;
    EXPECT_FALSE(find_not_finite(state));
}

}  // namespace
}  // namespace tvsgs
