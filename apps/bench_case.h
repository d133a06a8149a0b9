// Stored cases of the float64 oracle of tensor voting, and the largest differences from them.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "bench_field.h"
#include "io/npz.h"

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

/// Largest differences over the splats. Everything but `list` is measured with the oracle's own
/// lists, since ties that resolve the other way change sums.
struct CaseDifferences {
    bool same_length = false;  // of the lists; nothing else is measured if not
    double list = 0;           // relative error in distance of lists other than the oracle's: ties
    double tau = 0;            // relative
    // Of the splats that are not excused.
    double tensor = 0;      // relative to the tensor, or to 1% of the middle one if that is more
    double normal_deg = 0;  // where the eigenvalue gap allows
    int tensor_at = -1, normal_at = -1;  // the splats of these
    int splats = 0;
    int excused = 0;          // splats beyond a bound by less than ten times what a unit in the
                              // last place of the inputs does to them, computed in double
    double target_steps = 0;  // in steps of the virtual receivers; of equal choices
    double variability_deg = 0;
    double strength = 0;  // relative
    int lists_with_ties = 0;
    int targets_elsewhere = 0;  // another virtual receiver was chosen
    int flags = 0;     // normals that count as ambiguous here and not there, or the reverse
    int left_out = 0;  // the 5%/5% rule decides otherwise
    int weak = 0;      // splats not compared: below 1e-8 the votes that are zero here by definition
                       // decide
};

/// Runs the events of a case with given lists, or with a search of its own.
using RunCase = std::function<FieldOnHost(const std::vector<std::uint32_t>& receivers)>;
CaseDifferences compare_with_case(const VotingCase& stored, const RunCase& run);

/// What comes out otherwise than stored on `Device`.
template <class Device>
CaseDifferences compare_case_on(const VotingCase& stored, Device) {
    Gaussians<Device> splats;
    copy(stored.splats, splats);
    return compare_with_case(stored, RunCase([&](const std::vector<std::uint32_t>& receivers) {
                                 return run_events(splats, stored.options, stored.rounds,
                                                   receivers);
                             }));
}

// Bounds of section 6 of the specification.
inline constexpr double kTensorBound = 1e-4, kNormalBoundDeg = 0.1;

/// A difference and its bound.
struct CaseBound {
    const char* name;
    double value, limit;
    bool met() const { return value <= limit; }  // false for NaN
};
std::vector<CaseBound> case_bounds(const CaseDifferences& d);

}  // namespace tvsgs
