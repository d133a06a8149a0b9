// Stored cases of the float64 oracle of tensor voting (tests/data/tensor_voting), and how results
// compare with them.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "apps/bench/field.h"
#include "io/files/npz.h"

namespace tvsgs {

/// Inputs, rules and results as the oracle's --make writes them.
struct VotingCase {
    std::string name;
    Gaussians<Cpu> splats;
    TvOptions options;
    int rounds = 0;
    int k = 0;                             // receivers of each voter, as stored
    std::vector<std::uint32_t> receivers;  // [N, k]
    NpzArchive arrays;

    int size() const { return splats.size(); }
    const NpyArray& at(const std::string& array) const { return find_array(arrays, array); }
};

/// Throws Error(ExitCode::input) where an array is missing or has another shape.
VotingCase read_voting_case(const std::string& path);

/// How one result compares over the splats of a case.
struct CaseQuantity {
    const char* name;
    double bound;        // what any splat may differ by
    double ceiling;      // what the stored conditioning can excuse at the most
    double largest = 0;  // difference of the splats that are not excused
    int at = -1;         // the splat of that
    int defined = 0;     // splats that have this result in the case
    int compared = 0;    // of these, those where the case says one thing only
    int excused = 0;     // beyond the bound by what a unit in the last place of float does to them

    /// Compares the result of a splat. `moved`: by how much the oracle moves where its inputs are
    /// off by a unit in the last place; marks the splat in `excused_splats` where that explains it.
    void add(int splat, double difference, double moved, std::vector<bool>& excused_splats);
    /// Of what is wrong, one sentence; empty: nothing.
    std::string fault() const;
};

struct CaseComparison {
    bool same_length = false;  // of the lists; nothing else is measured if not
    int splats = 0;
    int lists_with_ties = 0;  // other lists than the oracle's, as good within rounding
    int excused = 0;          // splats excused in any quantity
    std::vector<CaseQuantity> quantities;

    /// Everything that is wrong; empty: the bounds are met.
    std::vector<std::string> faults() const;
};

// [docs/method/voting.md#bounds-of-agreement]
inline constexpr double kTensorBound = 1e-4, kNormalBoundDeg = 0.1;
inline constexpr double kExcusedShare = 0.01, kComparedShare = 0.9;

/// Runs the events of a case with given lists, or with a search of its own.
using RunCase = std::function<FieldOnHost(const std::vector<std::uint32_t>& receivers)>;

/// Everything but `list` is measured with the oracle's own lists, since ties that resolve the other
/// way change sums.
CaseComparison compare_with_case(const VotingCase& stored, const RunCase& run);

/// The same for what comes out on `Device`.
template <class Device>
CaseComparison compare_case_on(const VotingCase& stored, Device) {
    Gaussians<Device> splats;
    copy(stored.splats, splats);
    return compare_with_case(stored, RunCase([&](const std::vector<std::uint32_t>& receivers) {
                                 return run_events(splats, stored.options, stored.rounds,
                                                   receivers);
                             }));
}

}  // namespace tvsgs
