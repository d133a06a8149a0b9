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

    /// Runs the oracle once for each line of arguments, in one process: Python's imports take
    /// longer than a small case.
    static int run_oracle(const std::vector<std::string>& lines, const std::string& more = "") {
        const fs::path list = folder_ / "oracle_arguments.txt";
        {
            std::ofstream out(list);
            for (const std::string& line : lines) out << line << '\n';
        }
        return shell("OMP_NUM_THREADS=1 " + find_python() +
                     " -c 'import runpy, shlex, sys\n"
                     "oracle, lines = sys.argv[1:]\n"
                     "for line in open(lines):\n"
                     "    sys.argv = [oracle] + shlex.split(line)\n"
                     "    runpy.run_path(oracle, run_name=\"__main__\")' '" +
                     oracle() + "' '" + list.string() + "' " + more);
    }

    struct Case {
        std::string name, flags;  // what it tests, what the oracle makes it of
    };
    /// Requires agreement within the bounds, in both precisions on all devices.
    static void expect_agreement(const std::vector<Case>& cases) {
        const auto file = [](std::size_t i) {
            return "'" + (folder_ / ("case_" + std::to_string(i) + ".npz")).string() + "'";
        };
        std::vector<std::string> lines;
        for (const Case& c : cases) lines.push_back("--make " + file(lines.size()) + " " + c.flags);
        ASSERT_EQ(run_oracle(lines), 0);
        for (std::size_t i = 0; i < cases.size(); ++i)
            for (const std::string& device : devices())
                for (const std::string precision : {"single", "double"}) {
                    const std::string how = device + " --set tv.precision=" + precision;
                    SCOPED_TRACE(cases[i].name + ": " + cases[i].flags + " on " + how);
                    const Result r = vote("--case " + file(i) + " --device " + how);
                    ASSERT_EQ(r.code, 0) << r.err;
                    ASSERT_EQ(r.lines.size(), 1u);
                    std::printf("%-12s excused %s\n", cases[i].name.c_str(),
                                r.lines[0].at("excused").dump().c_str());
                }
    }

    static inline fs::path folder_;
};

}  // namespace tvsgs
