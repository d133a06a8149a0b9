// Tensor voting: splats vote for each other's tangent planes. [docs/method/voting.md]
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/options.h"
#include "core/scene/gaussians.h"
#include "core/stage_clock.h"
#include "tv/internal/neighbour_lists.h"

namespace tvsgs {

enum class NoiseMode { global, per_splat };
enum class ScaleRule { ten_percent_at_median, median };
enum class VoteMap { covariant, unit };
enum class VoteStrength { relative, literal };
enum class Curvature { literal, scale_free };
enum class Targets { votes, anchor };
enum class VotePrecision { single_precision, double_precision };

/// Options of tensor voting; fields() has their meaning.
struct TvOptions {
    bool enabled = true, whiten = true, fixed_check = true;
    int k = 100, start = 1, vote_every = 10, refresh_every = 100, min_votes = 3;
    float flatness_limit = 0, flatness_limit_position = 0, virtual_range = 1, target_margin = 0,
          max_vote_angle_deg = 90, fixed_weight = 10;
    NoiseMode whiten_noise_mode = NoiseMode::global;
    ScaleRule scale_rule = ScaleRule::ten_percent_at_median;
    Curvature curvature = Curvature::literal;
    VoteMap vote_map = VoteMap::covariant;
    VoteStrength strength = VoteStrength::relative;
    Targets targets = Targets::votes;
    VotePrecision precision = VotePrecision::single_precision;
    ListStorage lists = ListStorage::full;
    std::string fixed_voters;

    template <class Visitor>
    void fields(Visitor& field) {
        field("enabled", enabled, "use tensor voting; the two voting losses need it");
        field("k", k, {1, 512},
              "splats that each splat votes for, chosen from 2k Euclidean neighbours");
        field("start", start, {1, 1e9}, "first iteration with votes");
        field("vote_every", vote_every, {1, 1e9}, "iterations between voting events");
        field("refresh_every", refresh_every, {1, 1e9}, "iterations between neighbour searches");
        field("whiten", whiten,
              "vote in the space where the covariance of the voter is the unit sphere");
        field.choice("whiten_noise_mode", whiten_noise_mode, {"global", "per_splat"},
                     "scale of the whitening's regulariser: mean of all splats, or each splat's");
        field.choice("scale_rule", scale_rule, {"ten_percent_at_median", "median"},
                     "scale of voting, from the median neighbour distance; ten_percent_at_median: "
                     "a vote there has 10 %; median: the distance itself");
        field.choice("curvature", curvature, {"literal", "scale_free"},
                     "decay of a curved vote; literal: constant of the paper, depends on the size "
                     "of splats; scale_free: independent of it");
        field.choice("vote_map", vote_map, {"covariant", "unit"},
                     "length of a vote; covariant: as un-whitening gives it (paper); unit: 1");
        field("flatness_limit", flatness_limit, {0, 1},
              "smallest scale, as a share of the middle scale, for votes at centres");
        field("flatness_limit_position", flatness_limit_position, {0, 1},
              "smallest scale, as a share of the middle scale, for votes at virtual receivers");
        field.choice("strength", strength, {"relative", "literal"},
                     "strength of a vote; relative: saliency / lambda_1; literal: as in the paper");
        field.choice("targets", targets, {"votes", "anchor"},
                     "targets of the position loss; votes: voted positions; anchor: own centres");
        field("virtual_range", virtual_range, {0.05, 20},
              "distance of the virtual receivers, in largest scales");
        field("target_margin", target_margin, {0, 10},
              "least gain of saliency of a virtual receiver over the centre, in lambda_1");
        field("max_vote_angle_deg", max_vote_angle_deg, {1, 90},
              "largest angle of a vote to the tangent plane, degrees");
        field("min_votes", min_votes, {0, 1000},
              "received votes above 1e-3 that a splat needs for the position loss; 0: any");
        field.choice("precision", precision, {"single", "double"},
                     "precision of votes and sums; double is for validation");
        field.choice("lists", lists, {"full", "compact"},
                     "storage of neighbours; compact: one byte a vote instead of eight, same bits");
        field("fixed_voters", fixed_voters,
              "measured points that vote and never move (PLY, OBJ or GLB; optional normals and "
              "property 'weight'); empty: none");
        field("fixed_weight", fixed_weight, {0, 1e6},
              "strength of votes of measured points, times their weights; a splat's is at most 1");
        field("fixed_check", fixed_check,
              "stop with an error if measured points do not lie on the start cloud");
    }
};

/// Bits of TensorField::flags.
enum TensorFlag : std::uint8_t {
    kHasTensor = 1,      // a valid voting round has reached the splat at least once
    kNormalValid = 2,    // takes part in the normal loss
    kPositionValid = 4,  // takes part in the position loss
};

/// Results of the last voting event, constants of the losses until the next one.
template <class Device>
struct TensorField {
    Buffer<Sym3f, Device> tensors;      // [N] accumulated votes, world frame
    Buffer<Vec3f, Device> eigenvalues;  // [N] descending
    Buffer<Vec3f, Device>
        normals;  // [N] unit; direction of the smallest eigenvalue, sign arbitrary
    Buffer<Vec3f, Device> targets;       // [N] world point of largest saliency along the normal
    Buffer<std::uint8_t, Device> flags;  // [N] TensorFlag bits
};

/// Intermediate results of the last event on the host, for tests and reports.
struct VotingDetails {
    int k = 0;                             // receivers per voter
    std::vector<std::uint32_t> receivers;  // [N, k] zeros for splats that do not vote
    std::vector<std::int64_t> begin;       // [N + 1] index of the first voter of receiver i
    std::vector<std::uint32_t> voters;     // ascending; fixed voters are numbered from N on
    std::vector<float> tau;                // [N] scale of voting; 0: silent
    std::vector<float> variability;        // [N] radians; infinite if the normal is ambiguous
    std::vector<float> strength;           // [N] RMS of the received votes; infinite if ambiguous
    std::vector<std::uint8_t> left_out;    // [N] in the top 5% of variability and strength
};

/// Measured points that vote and never move. They are not rendered and have no loss.
struct FixedVoters {
    std::vector<Vec3f> means;
    std::vector<Vec3f> normals;  // unit
    std::vector<float> scales;   // world units; radius of the surface patch that a point represents
    std::vector<float> weights;  // strength of the votes; a splat has at most 1

    int size() const { return int(means.size()); }
};

/// Time of the stages of the last event, while profiling is on: "keys", "tree", "search", "reverse"
/// if lists were rebuilt; "records", "centres", "eigen", "masks", "virtual".
struct VotingProfile {
    std::vector<StageTime> stages;
    std::size_t bytes = 0;  // of lists and scratch memory, on the device
};

struct SplatSpans;
namespace detail {
template <class Device>
struct VotingState;
}

/// Runs the voting events. Keeps the neighbour lists and all scratch memory between events.
template <class Device>
class TensorVoter {
public:
    explicit TensorVoter(const TvOptions& options);
    ~TensorVoter();

    /// True at `start`, every `vote_every` iterations after it, and first after
    /// structure_changed().
    bool due(int step) const;

    /// Runs one voting event; searches neighbours if a refresh is due. With fewer than two splats
    /// it clears the field: nothing is valid. Without `targets` it skips the virtual receivers, and
    /// the targets are the centres. [docs/method/voting.md#one-event]
    void vote(int step,
              const Gaussians<Device>& gaussians,
              TensorField<Device>& field,
              bool targets = true);

    /// Call it after splats were added, removed or reordered: `parents[i]` is the old index of new
    /// splat i. Splats inherit tensors, and the next vote() searches neighbours again.
    void structure_changed(Span<const int> parents, TensorField<Device>& field);

    /// Replaces the fixed voters. The next vote() searches neighbours again.
    void set_fixed_voters(const FixedVoters& voters);

    /// State that, with the splats and the field, determines the next vote().
    struct Progress {
        int searched_at = -1;  // iteration of the current lists; -1: the next vote searches
        bool changed = false;  // structure_changed() since the last vote
    };
    Progress progress() const;

    /// Continues from a progress(). `searched`: the splats at iteration `searched_at`.
    void restore(const Progress& progress, const Gaussians<Device>& searched);

    /// With profiling on, vote() waits for the device after each stage.
    void set_profiling(bool on);
    VotingProfile profile() const;

    VotingDetails details() const;

    /// For tests: uses these lists [N, k] until the next refresh, as if searched at `step`.
    void set_receivers(int step, int k, const std::vector<std::uint32_t>& receivers);

private:
    void measure_noise(const SplatSpans& splats);
    void search(int step, const SplatSpans& splats);

    TvOptions options_;
    std::unique_ptr<detail::VotingState<Device>> state_;
};

}  // namespace tvsgs
