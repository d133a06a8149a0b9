// State of a training: how it starts, and how it is saved, restored and rolled back.
#pragma once

#include <algorithm>

#include "core/error.h"
#include "core/math/rng.h"
#include "optim/growth/init_cloud.h"
#include "optim/loop/iteration.h"
#include "optim/loop/train.h"
#include "optim/views/matchable.h"

namespace tvsgs {

/// Iterations between checks of all parameters.
inline constexpr int kCheckEvery = 100;

/// Draws training views without replacement, in a new random order each round.
class ViewSampler {
public:
    ViewSampler(int count, std::uint64_t seed) : order_(std::size_t(count)), seed_(seed) {}

    /// The view of an iteration; iterations count from 1.
    int view(int iteration) {
        const int views = int(order_.size()), round = (iteration - 1) / views;
        if (round != round_) shuffle(std::uint32_t(round));
        round_ = round;
        return order_[(iteration - 1) % views];
    }

private:
    void shuffle(std::uint32_t round) {
        for (std::size_t i = 0; i < order_.size(); ++i) order_[i] = int(i);
        for (std::size_t i = order_.size(); i > 1; --i) {
            const auto pick = std::size_t(
                uniform(random4(seed_, RandomStream::view_order, i, round).v[0]) * float(i));
            std::swap(order_[i - 1], order_[std::min(pick, i - 1)]);
        }
    }

    std::vector<int> order_;
    std::uint64_t seed_;
    int round_ = -1;
};

template <class Device>
auto make_terms(const Scene& scene, const TrainOptions& o) {
    // depth / 3 is near 1 on DTU as normalised by PGSR's authors, the source of published weights.
    const float depth = o.loss.length_unit == LengthUnit::depth ? median_depth(scene) : 0;
    return make_losses<Device>(o.loss, {depth > 0 ? depth / 3 : 1, int(scene.train.size()),
                                        std::uint64_t(o.seed), o.render.pixel_center});
}

/// All state of a training; built from the scene or from a saved state.
template <class Device>
struct TrainState {
    Gaussians<Device> gaussians;
    std::vector<std::unique_ptr<Loss<Device>>> losses;
    TensorVoter<Device> voter;
    TensorField<Device> field;
    Gaussians<Device> searched;  // means, scales, rotations at the last neighbour search
    Adam<Device> adam;
    Densifier<Device> densifier;
    TrainedCameras<Device> cameras;
    ViewSampler sampler;
    int done = 0;

    TrainState(const Scene& scene, const TrainOptions& o, const State* from)
        : gaussians(first_gaussians(scene, o, from)),
          losses(make_terms<Device>(scene, o)),
          voter(o.tv),
          adam(o.lr, gaussians),
          densifier(o.densify, scene.extent, std::uint64_t(o.seed)),
          cameras(scene, o.cameras),
          sampler(int(scene.train.size()), std::uint64_t(o.seed)) {
        if (o.tv.enabled && !scene.fixed_voters.positions.empty())
            voter.set_fixed_voters(make_fixed_voters(scene.fixed_voters, o.tv));
        if (from != nullptr)
            load(*from, o);
        else if (grows_in_gaps_only(o.densify))
            densifier.set_open(open_shares(scene.train, to_host(gaussians.means),
                                           uses_masks(o.loss.photometric.masks)));
    }

    void visit(StateVisitor<Device>& visit) {
        visit.value("iterations", done);
        visit_state(visit, "", gaussians);
        adam.state(visit);
        densifier.state(visit);
        for (const auto& term : losses) term->state(visit);
        cameras.state(visit);
        visit("tv.tensors", field.tensors);
        visit("tv.eigenvalues", field.eigenvalues);
        visit("tv.normals", field.normals);
        visit("tv.targets", field.targets);
        visit("tv.flags", field.flags);
        typename TensorVoter<Device>::Progress progress = voter.progress();
        visit.value("tv.searched_at", progress.searched_at);
        visit.value("tv.changed", progress.changed);
        if (!visit.loading() && progress.searched_at < 0) resize(searched, 0, 0);
        // Neighbour lists are not saved: they are large, and the searched splats determine them.
        for_each_array(
            [&](const SplatArray& array, auto& values) {
                if (array.shape) visit(str("tv.searched.", array.name), values);
            },
            searched);
        if (visit.loading()) voter.restore(progress, searched);
    }

private:
    static Gaussians<Device> first_gaussians(const Scene& scene,
                                             const TrainOptions& o,
                                             const State* from) {
        Gaussians<Device> g;
        if (from != nullptr) return g;
        Gaussians<Cpu> first = init_gaussians(scene, o.init, o.model.sh_degree);
        sort_by_place(first);
        copy(first, g);
        return g;
    }

    void load(const State& from, const TrainOptions& o) {
        check_start(from, o);
        check_shapes(from);
        StateVisitor<Device> visitor(from);
        visit(visitor);
    }

    /// Throws if array sizes do not match; else reads would go beyond the arrays' ends.
    static void check_shapes(const State& from) {
        int degree = 0;
        StateVisitor<Cpu> visitor(from);
        visitor.value("sh_degree", degree);
        const auto count_of = [&](const std::string& name) {
            const StateArray* const array = from.find(name);
            return array == nullptr ? std::size_t{0} : array->count();
        };
        const std::size_t n = count_of("means");
        const auto expect = [&](const std::string& name, std::size_t each, bool may_be_empty) {
            const std::size_t count = count_of(name);
            if (count != n * each && !(may_be_empty && count == 0))
                throw Error(ExitCode::input, "checkpoint array '", name, "' has ", count,
                            " elements, expected ", n * each);
        };
        Gaussians<Cpu> shapes;
        shapes.sh_degree = degree;
        for (const std::string prefix : {"", "adam.m.", "adam.v."})
            for_each_array(
                [&](const SplatArray& array, const auto&) {
                    expect(prefix + array.name, std::size_t(array.planes), array.optional);
                },
                shapes);
        expect("densify.statistics", 1, true);
        expect("densify.open", 1, true);
        const bool voted = count_of("tv.flags") > 0;
        for (const char* name : {"tensors", "eigenvalues", "normals", "targets", "flags"})
            expect(str("tv.", name), 1, !voted);
        int searched_at = 0;
        visitor.value("tv.searched_at", searched_at);
        for_each_array(
            [&](const SplatArray& array, const auto&) {
                if (array.shape) expect(str("tv.searched.", array.name), 1, searched_at < 0);
            },
            shapes);
        int done = -1;
        visitor.value("iterations", done);
        if (n == 0 || done < 0)
            throw Error(ExitCode::input, "the checkpoint has no splats or no iteration");
    }
};

/// A training state with its last good copy; rolls back when a number is not finite.
template <class Device>
class GuardedTraining {
public:
    GuardedTraining(const Scene& scene,
                    const TrainOptions& options,
                    const TrainCallbacks& callbacks,
                    SharedState start)
        : scene_(scene),
          options_(options),
          callbacks_(callbacks),
          injected_(callbacks.injected_fault),
          good_(std::move(start)) {
        if (const auto bad = good_ ? find_not_finite(*good_) : std::nullopt)
            throw Error(ExitCode::numerical, "checkpoint array '", bad->array,
                        "' is not finite at ", bad->element);
        restart();
        if (const auto fault = find_fault(0))
            throw Error(ExitCode::numerical, "the first splats: ", fault->what);
    }

    /// save() and check() replace the state when they roll back.
    TrainState<Device>& state() { return *state_; }

    void vote(int step) {
        TrainState<Device>& s = *state_;
        const auto targets_read = [&](const auto& term) {  // before the next event
            return term->needs().targets && term->active(step + options_.tv.vote_every);
        };
        s.voter.vote(step, s.gaussians, s.field,
                     std::any_of(s.losses.begin(), s.losses.end(), targets_read));
        if (!callbacks_.on_save || s.voter.progress().searched_at != step) return;
        for_each_array(
            [](const SplatArray& array, const auto& values, auto& searched) {
                if (array.shape) copy(values, searched);
            },
            s.gaussians, s.searched);
    }

    void watch(int step, int view, Span<double> values) {
        if (injected_.term >= 0 && injects_at(step))
            parallel_for(Device{}, 1, SpoilBody<double>{values.data + injected_.term});
        guard_.watch(step, view, values);
    }

    const int* halted() const { return guard_.halted(); }

    /// Grows, trims and resets splats when due, and notifies the voter and the rasteriser.
    void grow(int step, Iteration<Device>& iteration) {
        TrainState<Device>& s = *state_;
        const bool changed = s.densifier.step(
            step, iteration.backbone().statistics(), s.gaussians, s.adam,
            [&](const auto& count_views) { iteration.observe(s.gaussians, count_views); });
        if (changed) s.voter.structure_changed(s.densifier.parents(), s.field);
        iteration.prepare(step, changed, s.gaussians);
    }

    void step_done(int step) {
        state_->done = step;
        if (!injected_.group || !injects_at(step)) return;
        const GroupFloats floats = group_floats(state_->gaussians, *injected_.group);
        parallel_for(Device{}, 1, SpoilBody<float>{floats.begin + injected_.splat * floats.width});
    }

    /// Returns true when all parameters are finite; else rolls back to iteration state().done.
    bool check(int step) {
        const auto fault = find_fault(step);
        if (fault) roll_back(*fault);
        return !fault;
    }

    /// Checks like check(), and also Adam's moments; then passes the state to on_save.
    bool save() {
        const int done = state_->done;
        if (!check(done)) return false;
        SharedState state = capture();
        if (const auto bad = find_not_finite(*state)) {
            roll_back({str("iteration ", done, ": element ", bad->element, " of '", bad->array,
                           "' is not finite"),
                       {}});
            return false;
        }
        good_ = std::move(state);
        callbacks_.on_save(done, good_);
        return true;
    }

    /// Call it before an early end; it leaves a finite state.
    void stop() {
        if (callbacks_.on_save ? !save() : !check(state_->done)) {
            good_ = capture();
            if (callbacks_.on_save) callbacks_.on_save(state_->done, good_);
        }
    }

private:
    void restart() {
        // Free the old state first, so that the device never holds two.
        state_.reset();
        state_ = std::make_unique<TrainState<Device>>(scene_, options_, good_.get());
        guard_.reset();
    }

    auto find_fault(int step) {
        TrainState<Device>& s = *state_;
        return guard_.check(step, s.gaussians, s.losses, scene_.train);
    }

    SharedState capture() {
        auto state = std::make_shared<State>();
        StateVisitor<Device> visitor(*state);
        state_->visit(visitor);
        return state;
    }

    bool injects_at(int step) { return step == injected_.step && injected_.times-- > 0; }

    /// Restores good_ and lowers the rates of fault.groups (empty: of all); throws the second time.
    void roll_back(const Fault& fault) {
        restart();
        const int back = state_->done;
        std::vector<ParameterGroup> groups = fault.groups;
        for (int i = 0; fault.groups.empty() && i < kParameterGroups; ++i)
            groups.push_back(static_cast<ParameterGroup>(i));
        std::string rates;
        for (const ParameterGroup group : groups)
            rates += str(rates.empty() ? "" : ", ", rate_key(group));
        if (rolled_back_) {
            if (!good_) good_ = capture();
            if (callbacks_.on_save) callbacks_.on_save(back, good_);
            throw Error(ExitCode::numerical, fault.what, ", again after a rollback; lower ", rates,
                        callbacks_.on_save ? str(" and resume from iteration ", back) : "");
        }
        rolled_back_ = true;
        for (const ParameterGroup group : groups) state_->adam.lower_rate(group, 0.1f);
        if (callbacks_.on_rollback)
            callbacks_.on_rollback(back, str(fault.what, "; back to iteration ", back, ", with ",
                                             rates, " divided by 10 from there"));
    }

    const Scene& scene_;
    const TrainOptions& options_;
    const TrainCallbacks& callbacks_;
    InjectedFault injected_;
    SharedState good_;  // null: restart from the scene
    std::unique_ptr<TrainState<Device>> state_;
    Guard<Device> guard_;
    bool rolled_back_ = false;
};

}  // namespace tvsgs
