// Replays the seeds and a fixed number of damaged copies of them: a short scripts/fuzz.sh for every
// build, most useful with -DTVSGS_ASAN=ON.
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <random>

#include "fuzz_targets.h"

namespace tvsgs::fuzz {
namespace {

namespace fs = std::filesystem;

using Seeds = std::map<std::string, std::string>;  // bytes by file name

Seeds files_in(const fs::path& folder) {
    Seeds files;
    for (const auto& entry : fs::directory_iterator(folder)) {
        std::ifstream in(entry.path(), std::ios::binary);
        files[entry.path().filename()] = {std::istreambuf_iterator<char>(in), {}};
    }
    return files;
}

bool has_python() {
    static const bool found = std::system("python3 --version >/dev/null 2>&1") == 0;
    return found;
}

/// Adds the files of a folder with one folder for each reader.
void add_seeds(const fs::path& folder, std::map<std::string, Seeds>& by_reader) {
    for (const auto& reader : fs::directory_iterator(folder))
        by_reader[reader.path().filename()].merge(files_in(reader.path()));
}

/// Seeds by reader: the files that broke a reader once and, with Python, those of make_corpus.py.
const std::map<std::string, Seeds>& corpus() {
    static const std::map<std::string, Seeds> seeds = [] {
        std::map<std::string, Seeds> by_reader;
        add_seeds(TVSGS_SOURCE_DIR "/tests/fuzz/corpus", by_reader);
        const fs::path folder =
            fs::path(testing::TempDir()) / ("tvsgs_seeds_" + std::to_string(getpid()));
        const std::string command =
            "python3 '" TVSGS_SOURCE_DIR "/tests/fuzz/make_corpus.py' '" + folder.string() + "'";
        if (has_python()) {
            EXPECT_EQ(std::system(command.c_str()), 0) << command;
            add_seeds(folder, by_reader);
        }
        fs::remove_all(folder);
        return by_reader;
    }();
    return seeds;
}

/// Applies one to four damages.
std::string damaged(std::string bytes, const std::vector<std::string>& all, std::mt19937& random) {
    const auto below = [&](std::size_t n) { return n == 0 ? 0 : random() % n; };
    const char* const words[] = {"-1",  "nan", "1e309", "99999999999999999999", "\"", "[", "{", "0",
                                 "inf", "\n",  "../x",  "\xEF\xBB\xBF"};
    for (std::size_t damages = 1 + below(4); damages > 0; --damages) {
        const std::size_t at = below(bytes.size() + 1),
                          length = below(std::min<std::size_t>(bytes.size() - at, 64) + 1);
        switch (below(7)) {
            case 0:
                if (at < bytes.size()) bytes[at] = static_cast<char>(bytes[at] ^ 1 << below(8));
                break;
            case 1:
                for (std::size_t i = 0; i < std::min<std::size_t>(length, 8); ++i)
                    bytes[at + i] = static_cast<char>(below(2) ? 0xff : 0x7f);
                break;
            case 2:
                bytes.resize(at);
                break;
            case 3:
                bytes.erase(at, length);
                break;
            case 4:
                bytes.insert(at, bytes.substr(at, length));
                break;
            case 5:
                bytes.insert(at, words[below(std::size(words))]);
                break;
            default: {
                const std::string& other = all[below(all.size())];
                bytes.replace(at, length, other.substr(below(other.size() + 1), 64));
            }
        }
    }
    return bytes;
}

class Readers : public testing::TestWithParam<Target> {
protected:
    void SetUp() override {
        if (!has_python() && !corpus().contains(GetParam().name))
            GTEST_SKIP() << "no python3 to make the seeds";
        ASSERT_TRUE(corpus().contains(GetParam().name));
    }

    const Seeds& seeds() const { return corpus().at(GetParam().name); }
};

TEST_P(Readers, AnswerToSeedsAndTheirDamages) {
    const auto start = std::chrono::steady_clock::now();
    std::vector<std::string> all;
    for (const auto& [name, bytes] : seeds()) {
        run(GetParam(), bytes);
        all.push_back(bytes);
    }
    std::mt19937 random(1);
    // At least 50, more within a second: sanitizers make readers ten times as slow.
    for (int i = 0; i < 2000; ++i) {
        const std::string bytes = damaged(all[random() % all.size()], all, random);
        try {
            run(GetParam(), bytes);
        } catch (const std::exception& error) {
            const std::string file = testing::TempDir() + "fuzz_" + GetParam().name;
            std::ofstream(file, std::ios::binary) << bytes;
            FAIL() << "damage " << i << ", saved as " << file << ": " << error.what();
        }
        if (i >= 50 && std::chrono::steady_clock::now() - start > std::chrono::seconds(1)) break;
    }
}

/// Seeds named good_* are read without an error; otherwise only the first lines of a reader run.
TEST_P(Readers, ReadTheirGoodSeeds) {
    if (!has_python()) GTEST_SKIP() << "no python3 to make the seeds";
    int good = 0;
    for (const auto& [name, bytes] : seeds()) {
        if (!name.starts_with("good_")) continue;
        const fs::path folder = fs::path(testing::TempDir()) / "tvsgs_good_seed" / GetParam().name;
        const fs::path file = folder / GetParam().file;
        fs::create_directories(file.parent_path());
        std::ofstream(file, std::ios::binary) << bytes;
        EXPECT_NO_THROW(GetParam().read(folder.string(), file.string())) << name;
        fs::remove_all(folder);
        ++good;
    }
    EXPECT_GT(good, 0);
}

/// A recursive parser would use up its stack.
TEST(DeepFiles, AreRefused) {
    const auto nested = [](const std::string& before, const std::string& open) {
        std::string text = before;
        for (int i = 0; i < 200000; ++i) text += open;
        return text;
    };
    for (const Target& target : targets()) {
        if (!std::string_view(target.file).ends_with(".json")) continue;
        for (const std::string& bytes :
             {nested("", "{\"a\":"), nested("{\"box\":", "["), nested("{\"frames\":[", "[")})
            EXPECT_NO_THROW(run(target, bytes)) << target.name;
        // A reader copies unknown values; the copy is recursive.
        for (const auto& [before, after] :
             {std::pair{"{\"box\":", "}"},
              {"{\"camera_angle_x\":1,\"frames\":[{\"file_path\":\"image\",\"more\":", "}]}"}}) {
            const std::string closed = nested(before, "[") + std::string(200000, ']') + after;
            EXPECT_NO_THROW(run(target, closed)) << target.name;
        }
    }
}

INSTANTIATE_TEST_SUITE_P(Fuzz, Readers, testing::ValuesIn(targets()), [](const auto& target) {
    return std::string(target.param.name);
});

}  // namespace
}  // namespace tvsgs::fuzz
