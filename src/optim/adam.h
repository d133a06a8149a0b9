// Adam over the Gaussians' parameter groups.  [Kingma15], rates of 3DGS
#pragma once

#include <array>
#include <cmath>

#include "comm/communicator.h"
#include "core/options.h"
#include "core/parallel.h"
#include "core/state.h"
#include "optim/adam_step.h"
#include "optim/asked_harmonics.h"
#include "optim/waiting_harmonics.h"

namespace tvsgs {

struct AdamOptions {
    float position_start = 1.6e-4f, position_end = 1.6e-6f;
    int position_max_steps = 30000;
    float sh_dc = 2.5e-3f, sh_rest = 1.25e-4f, opacity = 0.05f, scale = 0.005f, rotation = 0.001f;

    template <class Visitor>
    void fields(Visitor& field) {
        field("position_start", position_start, {0, 1},
              "rate of the means at the start, in scene extents");
        field("position_end", position_end, {0, 1},
              "the same at position_max_steps; geometric in between");
        field("position_max_steps", position_max_steps, {1, 1e9},
              "iterations over which the means' rate falls");
        field("sh_dc", sh_dc, {0, 1}, "rate of the base colour");
        field("sh_rest", sh_rest, {0, 1}, "rate of the higher spherical harmonics");
        field("opacity", opacity, {0, 10}, "rate of the opacity logits");
        field("scale", scale, {0, 1}, "rate of the log scales");
        field("rotation", rotation, {0, 1}, "rate of the quaternions");
    }
};

/// Parameters that share a learning rate, in the order of the kinds in Gaussians.
enum class ParameterGroup { means, scales, rotations, opacities, sh_dc, sh_rest };
inline constexpr int kParameterGroups = 6, kGeometryGroups = 4;

/// Rate of the means at an iteration, world units.
inline float position_rate(const AdamOptions& o, int step, float extent) {
    const double u = std::min(1.0, static_cast<double>(step) / o.position_max_steps);
    return static_cast<float>(extent * std::pow(static_cast<double>(o.position_start), 1 - u) *
                              std::pow(static_cast<double>(o.position_end), u));
}

struct AdamBody {
    float *values, *m, *v;
    const float* gradients;
    float share;  // of what `gradients` has
    AdamScale scale;
    AdamDecay<float> decay;
    float least;  // values stay at or above it

    TVSGS_HD void operator()(int i) const {
        const float next =
            adam_update(values[i], gradients[i] * share, m[i], v[i], scale.step, scale.root, decay);
        values[i] = next < least ? least : next;
    }
};
/// body(i) for i in [0, count), unless *halted, where that is given, is not 0.
void update_parameters(Cpu, int count, const AdamBody& body, const int* halted);
void update_parameters(Cuda, int count, const AdamBody& body, const int* halted);

template <class Device>
class Adam {
public:
    /// Each step stands for `batch` photographs. Of several processes each has the moments of its
    /// part of the splats, takes their step, and tells the others; of the harmonics, with `asks`,
    /// only those that fetch_harmonics() asks for. Where the splats' harmonics lie their moments
    /// will, too. Where that is the host's memory, or with `waits`, the harmonics' steps wait until
    /// they are seen: the fused step is the only one then, and needs fetch_harmonics() before.
    Adam(const AdamOptions& options,
         const Gaussians<Device>& gaussians,
         int batch = 1,
         Communicator* peers = nullptr,
         bool waits = false,
         bool asks = false)
        : options_(options),
          batch_(batch),
          decay_(adam_decay(batch)),
          peers_(peers),
          waits_(waits || gaussians.sh.memory() == Memory::host),
          asks_(asks && peers != nullptr) {
        set_splats(gaussians.size());
        m_.sh.put(gaussians.sh.memory()), v_.sh.put(gaussians.sh.memory());
        resize(m_, part().size(), gaussians.sh_degree);
        resize(v_, part().size(), gaussians.sh_degree);
        fill_zero(m_);
        fill_zero(v_);
    }

    /// One step of all parameters along `share` of gradients in memory, of this process's part: the
    /// plain way. `step` sets the position rate; `sh_degree` is the degree in use: above it
    /// gradients and moments are zero. Where *halted (on the device; may be null) is not 0, nothing
    /// changes.
    void step(int step,
              float extent,
              int sh_degree,
              const Gaussians<Device>& gradients,
              Gaussians<Device>& g,
              bool with_opacity,
              const int* halted = nullptr,
              float share = 1) {
        using enum ParameterGroup;
        begin_step(step, extent);
        const float none = -INFINITY;  // a bound would hide what is not finite
        const Part own = part();
        const std::size_t n = g.means.size();
        const auto update = [&](ParameterGroup group, auto& values, const auto& dL, auto& m,
                                auto& v, float least, std::size_t plane, std::size_t planes) {
            constexpr std::size_t width = sizeof(*values.data()) / sizeof(float);
            // Planes of all splats lie one after the other.
            const bool whole = peers_ == nullptr;
            const std::size_t count = static_cast<std::size_t>(own.size()),
                              length = whole ? planes * n : count;
            for (std::size_t p = plane; p < plane + planes; p += whole ? planes : 1) {
                const auto floats = [at = p * count](auto* data) {
                    return reinterpret_cast<float*>(data + at);
                };
                const AdamBody body{reinterpret_cast<float*>(values.data() + p * n +
                                                             static_cast<std::size_t>(own.begin)),
                                    floats(m.data()),
                                    floats(v.data()),
                                    reinterpret_cast<const float*>(dL.data() + p * count),
                                    share,
                                    {rate(group), root_},
                                    decay_,
                                    least};
                update_parameters(Device{}, static_cast<int>(length * width), body, halted);
            }
            return Communicator::Planes{values.data() + plane * n, sizeof *values.data(),
                                        static_cast<int>(planes)};
        };
        std::vector<Communicator::Planes> moved{
            update(means, g.means, gradients.means, m_.means, v_.means, none, 0, 1),
            update(scales, g.log_scales, gradients.log_scales, m_.log_scales, v_.log_scales,
                   kLeastLogScale, 0, 1),
            update(rotations, g.quats, gradients.quats, m_.quats, v_.quats, none, 0, 1)};
        if (with_opacity)
            moved.push_back(update(opacities, g.opacity_logits, gradients.opacity_logits,
                                   m_.opacity_logits, v_.opacity_logits, none, 0, 1));
        const int coefficients = sh_count(sh_degree);
        const auto step_harmonics = [&] {
            return std::array{update(sh_dc, g.sh, gradients.sh, m_.sh, v_.sh, none, 0, 1),
                              update(sh_rest, g.sh, gradients.sh, m_.sh, v_.sh, none, 1,
                                     static_cast<std::size_t>(coefficients) - 1)};
        };
        if (asks_) {  // they stay where they are, and are moved while the others go round
            share_parts(peers_, "geometry", Device{}, moved, g.size(), [&] { step_harmonics(); });
            asked_.step_done(coefficients);
        } else {
            for (const Communicator::Planes& planes : step_harmonics()) moved.push_back(planes);
            share_parts(peers_, "parameters", Device{}, moved, g.size());
        }
    }

    /// The same from what the splats add up over pixels, and what losses add to the geometry
    /// (`extra`; empty: nothing), without gradients of parameters in memory. Of one process, as
    /// gradients of several photographs have to be added up.
    void step(int step,
              float extent,
              int sh_degree,
              const FusedGradients& gradients,
              Gaussians<Device>& extra,
              Gaussians<Device>& g,
              bool with_opacity,
              const int* halted = nullptr) {
        using enum ParameterGroup;
        const ShAdam all = sh_of(g, sh_degree);
        if (waits_) waiting_.begin(all, steps_from_now());
        begin_step(step, extent);
        AdamStep now{geometry_spans(g),
                     geometry_spans(m_),
                     geometry_spans(v_),
                     geometry_spans(extra),
                     all,
                     {rate(means), rate(scales), rate(rotations), rate(opacities), root_, decay_},
                     sh_scale(count_),
                     with_opacity,
                     halted};
        if (!waits_) return take_step(Device{}, g.size(), gradients, now);
        now.sh = waiting_.in_view(), now.taken = waiting_.taken(), now.due = waiting_.due();
        take_step(Device{}, g.size(), gradients, now);
        waiting_.step_done(all);
    }

    /// Whether forward() has to fetch harmonics.
    bool fetches() const { return waits_ || asks_; }
    /// Whether find_not_finite() can look at harmonics between two steps for nothing: all of them
    /// are in this device's memory.
    bool at_hand(const Gaussians<Device>& g) const {
        return !asks_ && g.sh.memory() == Memory::device;
    }

    /// For what else goes from process to process between two photographs.
    OnItsWay<Device>& on_its_way() { return asked_.on_its_way(); }

    /// With several processes, before each photograph: fetch_harmonics() will be of another one.
    void begin_photograph() { asked_.begin_photograph(); }
    /// On a process that has none, while others fetch those of theirs.
    void answer_others(Gaussians<Device>& g) {
        if (asks_) asked_.ask(*peers_, g, nullptr);
    }

    /// For the view that the next step is of: its harmonics, up to date.
    Harmonics fetch_harmonics(const SplatPlaces& places,
                              std::size_t room,
                              int sh_degree,
                              Gaussians<Device>& g) {
        if (asks_) {
            asked_.ask(*peers_, g, &places);
            return {g.sh.data(), g.means.size(), /*by_place=*/false};
        }
        if (!waits_) throw Error(ExitCode::internal, "harmonics are fetched, but none waits");
        return waiting_.fetch(sh_of(g, sh_degree), places, room, steps_from_now());
    }

    /// Takes the steps that wait, and what other processes have moved: before anything else reads
    /// or moves harmonics or their moments. Changes no bit of what follows. All processes call it.
    void catch_up(Gaussians<Device>& g) {
        if (waits_) waiting_.catch_up(sh_of(g, g.sh_degree));
        if (asks_) asked_.catch_up(*peers_, g);
    }

    /// From now on the group's rate is `factor` x what it would have been.
    void lower_rate(ParameterGroup group, float factor) {
        rate_factors_[static_cast<std::size_t>(group)] *= factor;
    }

    void state(StateVisitor<Device>& visit) {
        visit.value("adam.count", count_);
        visit.value("adam.rate_factors", rate_factors_);
        visit_moments(visit, "adam.m.", m_);
        visit_moments(visit, "adam.v.", v_);
    }

    /// After the number of splats has changed, and with it the parts of the processes.
    void set_splats(int count) { splats_ = count; }
    /// The splats whose moments are held here, in order.
    Part part() const { return own_part(peers_, splats_); }

    Gaussians<Device>& first_moments() { return m_; }
    Gaussians<Device>& second_moments() { return v_; }

private:
    void visit_moments(StateVisitor<Device>& visit,
                       const std::string& prefix,
                       Gaussians<Device>& moments) {
        if (visit.loading()) visit.value(prefix + "sh_degree", moments.sh_degree);
        for_each_array(
            [&](const SplatArray& array, auto& values) {
                if (!array.optional) visit.part(prefix + array.name, values, splats_, array.planes);
            },
            moments);
        if (!visit.loading()) visit.value(prefix + "sh_degree", moments.sh_degree);
    }

    void begin_step(int step, float extent) {
        position_rate_ = position_rate(options_, step, extent);
        root_ = adam_scale(1, ++count_, batch_).root;
    }

    ShAdam sh_of(Gaussians<Device>& g, int sh_degree) {
        return {g.sh.data(), m_.sh.data(), v_.sh.data(), g.means.size(), sh_count(sh_degree)};
    }

    auto steps_from_now() const {
        return [this](int t) { return sh_scale(count_ + t); };
    }

    /// Of the t-th step.
    ShScale sh_scale(int t) const {
        return {rate(ParameterGroup::sh_dc, t), rate(ParameterGroup::sh_rest, t),
                adam_scale(1, t, batch_).root, decay_};
    }

    /// With the bias correction of the step in progress, or of the t-th.
    float rate(ParameterGroup group) const { return rate(group, count_); }
    float rate(ParameterGroup group, int t) const {
        const float rates[] = {position_rate_,   options_.scale, options_.rotation,
                               options_.opacity, options_.sh_dc, options_.sh_rest};
        const auto i = static_cast<std::size_t>(group);
        const float at_once = std::sqrt(static_cast<float>(batch_));
        return adam_scale(rates[i] * rate_factors_[i] * at_once, t, batch_).step;
    }

    AdamOptions options_;
    int batch_;
    AdamDecay<float> decay_;
    Communicator* peers_;
    bool waits_, asks_;
    int splats_ = 0;
    Gaussians<Device> m_, v_;  // of the part
    WaitingHarmonics<Device> waiting_;
    AskedHarmonics<Device> asked_;
    std::array<float, kParameterGroups> rate_factors_{1, 1, 1, 1, 1, 1};
    int count_ = 0;
    float position_rate_ = 0, root_ = 1;  // of the step in progress
};

}  // namespace tvsgs
