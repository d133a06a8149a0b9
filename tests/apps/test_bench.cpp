// tvsgs-bench: new cases of the oracle, refused input, and timings.
#include "apps/test_bench.h"

namespace tvsgs {
namespace {

using nlohmann::json;

TEST_F(Bench, AgreesWithTheOracleOnFreshCases) {
    if (const std::string why = no_oracle(); !why.empty()) GTEST_SKIP() << why;
    std::vector<Case> cases = {
        {"few", "--shape sphere --n 50 --k 100 --seed 11"},  // fewer than 2k
        {"smallest_k", "--shape planes --n 150 --k 4 --seed 12"},
        {"sphere", "--shape sphere --n 150 --k 33 --seed 13 --mode per_splat"},
        {"cluster", "--shape cluster --n 200 --k 50 --seed 14 --vote-map unit"},
        {"limit", "--shape planes --n 250 --k 100 --seed 15 --flatness-limit 1"},
        {"plain", "--shape sphere --n 200 --k 16 --seed 16 --no-whiten"}};
    for (const std::string rules :
         {"",
          " --vote-map unit --flatness-limit 1 --flatness-limit-position 1 --curvature scale_free"})
        for (const std::string shape : {"sphere --spacings 0.1", "sphere --spacings 3", "needles",
                                        "planes --shift 1e5", "cluster --shift 1e5"})
            cases.push_back({shape, "--n 120 --seed 17 --shape " + shape + rules});
    expect_agreement(cases);
}

TEST_F(Bench, TheOracleRepeatsItsStoredCases) {
    if (const std::string why = no_oracle(); !why.empty()) GTEST_SKIP() << why;
    const fs::path out = folder_ / "oracle.txt";
    std::vector<std::string> cases;
    for (const std::string name : {"planes", "limits", "literal_strength", "median"})
        cases.push_back("'" + test_data("tensor_voting/cases/") + name + ".npz'");
    ASSERT_EQ(run_oracle(cases, ">'" + out.string() + "'"), 0);
    std::ifstream lines(out);
    int quantities = 0;
    for (std::string line; std::getline(lines, line); ++quantities) {
        EXPECT_LT(std::stod(line.substr(line.find_last_of(' '))), 1e-6) << line;
        // Splats without a defined normal, of 220.
        EXPECT_LE(std::stoi(line.substr(line.find("left out ") + 9)), 5) << line;
    }
    EXPECT_EQ(quantities, 4 * 20);
}

TEST_F(Bench, SaysWhatItCannotUse) {
    EXPECT_EQ(vote("").code, 2);
    EXPECT_EQ(vote("--case a.npz --synthetic 10").code, 2);
    EXPECT_EQ(vote("--synthetic 100 --shape cube").code, 2);
    EXPECT_EQ(vote("--synthetic 100 --device cpu --set tv.kk=3").code, 2);
    EXPECT_EQ(vote("--case nowhere.npz --device cpu").code, 3);
    std::ofstream(folder_ / "text.npz") << "no archive";
    EXPECT_EQ(vote("--case '" + (folder_ / "text.npz").string() + "' --device cpu").code, 3);
}

TEST_F(Bench, TimesEveryShape) {
    for (const std::string& device : devices())
        for (const std::string shape :
             {"sphere", "planes", "cluster", "line", "coincident", "outliers"}) {
            SCOPED_TRACE(shape + " on " + device);
            const Result r =
                vote("--synthetic 700 --repetitions 2 --warm-up 1 --set tv.k=20 --shape " + shape +
                     " --device " + device);
            ASSERT_EQ(r.code, 0) << r.err;
            ASSERT_EQ(r.lines.size(), 1u);
            const json& line = r.lines[0];
            EXPECT_GT(line.at("event_ms").get<double>(), 0);
            // Every usable splat lists k others, and all splats of these shapes are usable.
            EXPECT_DOUBLE_EQ(line.at("counters").at("in_degree_mean").get<double>(), 20);
            EXPECT_GT(line.at("memory").at("voter_and_field_bytes").get<double>(), 700 * 20 * 4);
        }
}

TEST_F(Bench, CloudsDependOnTheSeedAlone) {
    const std::string same = "--synthetic 500 --repetitions 1 --device cpu --set tv.k=10 --seed ";
    const auto counters = [&](const std::string& seed) {
        const Result r = vote(same + seed);
        return r.code == 0 ? r.lines.at(0).at("counters").dump() : r.err;
    };
    EXPECT_EQ(counters("1"), counters("1"));
    EXPECT_NE(counters("1"), counters("2"));
}

}  // namespace
}  // namespace tvsgs
