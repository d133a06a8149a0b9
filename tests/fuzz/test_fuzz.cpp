// Replays the seeds and what a fixed number of small damages makes of them; a short stand-in for
// scripts/fuzz.sh in every build, most useful with -DTVSGS_ASAN=ON.
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>

#include "fuzz_targets.h"

namespace tvsgs::fuzz {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> seeds(const Target& target) {
    std::vector<fs::path> files;
    for (const auto& entry :
         fs::directory_iterator(fs::path(TVSGS_SOURCE_DIR) / "tests/fuzz/corpus" / target.name))
        files.push_back(entry.path());
    std::sort(files.begin(), files.end());
    std::vector<std::string> out;
    for (const fs::path& file : files) {
        std::ifstream in(file, std::ios::binary);
        out.emplace_back(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
    }
    return out;
}

/// One to four damages.
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

class Readers : public testing::TestWithParam<Target> {};

TEST_P(Readers, AnswerToSeedsAndTheirDamages) {
    const auto start = std::chrono::steady_clock::now();
    const std::vector<std::string> all = seeds(GetParam());
    ASSERT_FALSE(all.empty());
    for (const std::string& seed : all) run(GetParam(), seed);
    std::mt19937 random(1);
    // As many as there is time for, at least 50: sanitizers make readers ten times as slow.
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

/// Seeds named good_* have to be read without an error: else only the first lines of a reader run.
TEST_P(Readers, ReadTheirGoodSeeds) {
    int good = 0;
    for (const auto& entry : fs::directory_iterator(fs::path(TVSGS_SOURCE_DIR) /
                                                    "tests/fuzz/corpus" / GetParam().name)) {
        if (!entry.path().filename().string().starts_with("good_")) continue;
        const fs::path folder = fs::path(testing::TempDir()) / "tvsgs_good_seed" / GetParam().name;
        const fs::path file = folder / GetParam().file;
        fs::create_directories(file.parent_path());
        fs::copy_file(entry.path(), file, fs::copy_options::overwrite_existing);
        EXPECT_NO_THROW(GetParam().read(folder.string(), file.string())) << entry.path();
        fs::remove_all(folder);
        ++good;
    }
    EXPECT_GT(good, 0);
}

/// What would use up the stack of a parser that calls itself.
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
        // Where a reader copies what it does not know, the copy calls itself.
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
