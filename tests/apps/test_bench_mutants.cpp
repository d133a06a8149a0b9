// The check of votes must find errors: stored results with one change each.
#include <algorithm>
#include <cmath>
#include <functional>

#include "apps/test_bench.h"
#include "support/npz_file.h"

namespace tvsgs {
namespace {

using Change = std::function<void(NpzArchive&)>;

std::string stored(const std::string& name) {
    return test_data("tensor_voting/cases/") + name + ".npz";
}

class Mutants : public Bench {
protected:
    /// Exit code 8, with a complaint about `what`.
    static void expect_caught(const std::string& name,
                              const std::string& of,
                              const std::string& what,
                              const Change& change) {
        SCOPED_TRACE(name);
        NpzArchive arrays = read_npz(stored(of));
        change(arrays);
        const std::string path = (folder_ / "mutant.npz").string();
        test::write_npz(path, arrays);
        for (const std::string precision : {"single", "double"}) {
            const Result r =
                vote("--case '" + path + "' --device cpu --set tv.precision=" + precision);
            EXPECT_EQ(r.code, 8) << r.err;
            EXPECT_NE(r.err.find(what), std::string::npos) << r.err;
            ASSERT_EQ(r.lines.size(), 1u);
            EXPECT_FALSE(r.lines[0].at("met").get<bool>());
        }
    }
};

std::vector<double>& numbers(NpzArchive& arrays, const std::string& name) {
    return arrays.at(name).numbers;
}

double percentile95(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    const double rank = 0.95 * static_cast<double>(values.size() - 1);
    const auto low = static_cast<std::size_t>(rank);
    return values[low] + (values[low + 1] - values[low]) * (rank - std::floor(rank));
}

TEST_F(Mutants, AnUnchangedCaseInAFileOfOursPasses) {
    NpzArchive arrays = read_npz(stored("far"));
    const std::string path = (folder_ / "same.npz").string();
    test::write_npz(path, arrays);
    EXPECT_EQ(vote("--case '" + path + "' --device cpu").code, 0);
}

TEST_F(Mutants, OneNormalTurnedByNinetyDegrees) {
    expect_caught("one normal", "sphere", "normal_deg of splat 17", [](NpzArchive& a) {
        double* const n = &numbers(a, "normal")[3 * 17];
        const double x = n[0];
        n[0] = -n[1] / std::hypot(x, n[1]), n[1] = x / std::hypot(x, n[1]), n[2] = 0;
    });
}

TEST_F(Mutants, AFewTensorsFarFromZero) {
    expect_caught("4.8 % of the tensors", "far", "tensor of splat", [](NpzArchive& a) {
        auto& T = numbers(a, "tensor");
        for (std::size_t i = 0; i < T.size() / 6; i += 21)
            for (std::size_t c = 0; c < 6; ++c) T[6 * i + c] *= 1.05;
    });
    expect_caught("a thousandth in all", "far", "tensor of splat", [](NpzArchive& a) {
        for (double& x : numbers(a, "tensor")) x *= 1.001;
    });
}

TEST_F(Mutants, AnotherReceiverSpacing) {
    expect_caught("spacing", "sphere", "target_steps", [](NpzArchive& a) {
        const auto& means = numbers(a, "means");
        auto& target = numbers(a, "target");
        for (std::size_t i = 0; i < target.size(); ++i)
            target[i] = means[i] + 1.2 * (target[i] - means[i]);
    });
    expect_caught("sides exchanged", "planes", "target_saliency", [](NpzArchive& a) {
        const auto& means = numbers(a, "means");
        auto& target = numbers(a, "target");
        for (std::size_t i = 0; i < target.size(); ++i) target[i] = 2 * means[i] - target[i];
    });
    expect_caught("all targets at the centres", "sphere", "target_saliency",
                  [](NpzArchive& a) { numbers(a, "target") = numbers(a, "means"); });
}

TEST_F(Mutants, TargetsThatAreNoPlaces) {
    for (const double far : {6.0, 1e30, std::nan("")})
        expect_caught("far away", "sphere", "target_steps", [far](NpzArchive& a) {
            const auto &means = numbers(a, "means"), &normal = numbers(a, "normal");
            auto& target = numbers(a, "target");
            for (std::size_t i = target.size() - 3; i < target.size(); ++i)
                target[i] = means[i] + far * normal[i];
        });
}

TEST_F(Mutants, CasesThatSayTooLittle) {
    const std::string path = (folder_ / "poor.npz").string();
    const auto code_without = [&](const Change& change) {
        NpzArchive arrays = read_npz(stored("sphere"));
        change(arrays);
        test::write_npz(path, arrays);
        return vote("--case '" + path + "' --device cpu").code;
    };
    EXPECT_EQ(code_without([](NpzArchive& a) { a.erase("position_valid"); }), 3);
    EXPECT_EQ(code_without([](NpzArchive& a) { a.erase("moved_tensor"); }), 3);
    EXPECT_EQ(code_without([](NpzArchive& a) { a.at("curvature").text = "scalefree"; }), 3);
}

TEST_F(Mutants, AMaskOfEitherInsteadOfBoth) {
    expect_caught("mask", "planes", "left_out", [](NpzArchive& a) {
        const auto &v = numbers(a, "variability"), &s = numbers(a, "strength");
        const double limit_v = percentile95(v), limit_s = percentile95(s);
        auto& left_out = numbers(a, "left_out");
        for (std::size_t i = 0; i < left_out.size(); ++i)
            left_out[i] = v[i] > limit_v || s[i] > limit_s;
    });
    expect_caught("at 96 %", "masks", "left_out", [](NpzArchive& a) {
        auto& left_out = numbers(a, "left_out");
        *std::find(left_out.begin(), left_out.end(), 1) = 0;
    });
    expect_caught("one vote more asked for", "masks", "position_valid",
                  [](NpzArchive& a) { numbers(a, "min_votes")[0] = 7; });
    expect_caught("no margin", "masks", "target_saliency",
                  [](NpzArchive& a) { numbers(a, "target_margin")[0] = 0; });
    expect_caught("nobody masked", "planes", "position_valid", [](NpzArchive& a) {
        for (double& flag : numbers(a, "position_valid")) flag = 1;
    });
}

TEST_F(Mutants, NumbersThatAreNotThose) {
    expect_caught("strengths", "sphere", "strength of splat", [](NpzArchive& a) {
        for (double& x : numbers(a, "strength")) x = 1e-9;
    });
    expect_caught("one strength", "sphere", "strength of splat 3",
                  [](NpzArchive& a) { numbers(a, "strength")[3] *= 1.01; });
    expect_caught("scales of voting", "unit", "tau of splat", [](NpzArchive& a) {
        for (double& x : numbers(a, "tau")) x *= 1.0001;
    });
    expect_caught("one variability", "sphere", "variability of splat 5",
                  [](NpzArchive& a) { numbers(a, "variability")[5] += 0.02; });
    expect_caught("not a number", "sphere", "tensor of splat 9",
                  [](NpzArchive& a) { numbers(a, "tensor")[6 * 9] = std::nan(""); });
    expect_caught("other curvature", "scale_free_large", "tensor of splat",
                  [](NpzArchive& a) { a.at("curvature").text = "literal"; });
    expect_caught("lists", "sphere", "tau of splat 0", [](NpzArchive& a) {
        auto& index = numbers(a, "index");
        for (double j = 0; j < 220; ++j)  // the farthest of all
            if (std::find(index.begin(), index.begin() + 20, j) == index.begin() + 20 && j > 0) {
                const auto& p = numbers(a, "means");
                const auto at = [&](double i, int c) {
                    return p[3 * std::size_t(i) + std::size_t(c)];
                };
                if (at(0, 0) * at(j, 0) + at(0, 1) * at(j, 1) + at(0, 2) * at(j, 2) < -0.8) {
                    index[0] = j;
                    return;
                }
            }
    });
}

TEST_F(Mutants, ConditioningExcusesLittle) {
    const auto poor = [](NpzArchive& a) {
        for (const char* name : {"moved_tensor", "moved_normal_deg", "moved_saliency",
                                 "moved_variability", "moved_strength", "moved_tau"})
            for (double& x : numbers(a, name)) x = 1e3;
    };
    expect_caught("one beyond the ceiling", "sphere", "tensor of splat 40", [&](NpzArchive& a) {
        poor(a);
        for (std::size_t c = 0; c < 6; ++c) numbers(a, "tensor")[6 * 40 + c] *= 1.1;
    });
    expect_caught("too many", "sphere", "by rounding", [&](NpzArchive& a) {
        poor(a);
        for (double& x : numbers(a, "tensor")) x *= 1.005;
    });
    expect_caught("nothing is said", "sphere", "can be compared", [](NpzArchive& a) {
        for (double& flag : numbers(a, "has_tensor")) flag = 2;
    });
    expect_caught("flags left open", "sphere", "position_valid can be compared", [](NpzArchive& a) {
        for (double& flag : numbers(a, "position_valid")) flag = 2;
    });
    expect_caught("no normals", "sphere", "normal_deg can be compared", [](NpzArchive& a) {
        for (double& flag : numbers(a, "normal_valid")) flag = 0;
    });
}

}  // namespace
}  // namespace tvsgs
