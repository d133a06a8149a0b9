// Runs tvsgs-bench on cases that the oracle makes during the test.
#pragma once

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "support/numeric.h"
#include "support/test_data.h"

namespace tvsgs {

namespace fs = std::filesystem;

inline int shell(const std::string& line) {
    const int status = std::system(line.c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

/// A Python with numpy and scipy; empty if there is none.
inline const std::string& find_python() {
    static const std::string found = [] {
        for (const std::string python : {"python3", "/usr/bin/python3"})
            if (shell(python + " -c 'import numpy, scipy' >/dev/null 2>&1") == 0) return python;
        return std::string();
    }();
    return found;
}

class Bench : public testing::Test {
protected:
    struct Result {
        int code;
        std::vector<nlohmann::json> lines;
        std::string err;
    };

    static void SetUpTestSuite() {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_bench_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }

    static Result vote(const std::string& arguments) { return bench("vote " + arguments); }
    static Result bench(const std::string& arguments) {
        const fs::path out = folder_ / "out.txt", err = folder_ / "err.txt";
        const int code = shell("OMP_NUM_THREADS=1 " TVSGS_BIN_DIR "/tvsgs-bench " + arguments +
                               " >'" + out.string() + "' 2>'" + err.string() + "'");
        Result result{code, {}, ""};
        std::ifstream lines(out);
        for (std::string line; std::getline(lines, line);)
            result.lines.push_back(nlohmann::json::parse(line));
        std::ostringstream text;
        text << std::ifstream(err).rdbuf();
        result.err = text.str();
        return result;
    }

    static std::vector<std::string> devices() {
        if (test::no_cuda().empty()) return {"cpu", "cuda"};
        return {"cpu"};
    }

    /// Why no case can be made; empty if one can.
    static std::string no_oracle() {
        if (find_python().empty()) return "no python3 with numpy and scipy";
        return "";
    }
    static std::string oracle() { return test_data("tensor_voting/tensor_voting.py"); }

    /// Makes the oracle write a case; returns its path.
    static std::string make_case(const std::string& name, const std::string& flags) {
        const std::string path = (folder_ / (name + ".npz")).string();
        EXPECT_EQ(shell("OMP_NUM_THREADS=1 " + find_python() + " '" + oracle() + "' --make '" +
                        path + "' " + flags),
                  0)
            << flags;
        return path;
    }

    /// Requires agreement within the bounds, in both precisions on all devices.
    static void expect_agreement(const std::string& name, const std::string& flags) {
        const std::string path = make_case(name, flags);
        for (const std::string& device : devices())
            for (const std::string precision : {"single", "double"}) {
                const std::string how = device + " --set tv.precision=" + precision;
                SCOPED_TRACE(name + ": " + flags + " on " + how);
                const Result r = vote("--case '" + path + "' --device " + how);
                ASSERT_EQ(r.code, 0) << r.err;
                ASSERT_EQ(r.lines.size(), 1u);
                std::printf("%-12s excused %s\n", name.c_str(),
                            r.lines[0].at("excused").dump().c_str());
            }
    }

    static inline fs::path folder_;
};

}  // namespace tvsgs
