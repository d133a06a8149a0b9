// The photographs of a step where it looks at several: which process looks at which, and what they
// find, added up in the order of the photographs. So neither the number of processes nor who is
// first has a say in the bits.  [docs/guide/ranks.md]
#pragma once

#include <cstring>

#include "core/scan.h"
#include "optim/train_state.h"

namespace tvsgs {

/// What one photograph, or all of a step, says of the splats.
struct SplatFindings {
    GeometrySpans geometry;
    Vec3f* sh;                     // coefficient major
    std::size_t stride;            // splats
    int coefficients;              // in use
    GrowthStatistics* statistics;  // null: not asked for

    /// Words of a record: the splat's index, its geometry, its statistics, its harmonics.
    static constexpr int kFixedWords = 16;
    TVSGS_HD int words() const { return kFixedWords + 3 * coefficients; }
};

/// The findings of one splat, word by word in the order of a record, without the index.
template <class Visit>
TVSGS_HD void visit_floats(const SplatFindings& f, int i, const Visit& visit) {
    const auto vector = [&visit](int word, Vec3f& v) {
        visit(word, v.x), visit(word + 1, v.y), visit(word + 2, v.z);
    };
    vector(1, f.geometry.means[i]);
    vector(4, f.geometry.log_scales[i]);
    Quatf& q = f.geometry.quats[i];
    visit(7, q.w), visit(8, q.x), visit(9, q.y), visit(10, q.z);
    visit(11, f.geometry.opacity_logits[i]);
    for (int k = 0; k < f.coefficients; ++k)
        vector(SplatFindings::kFixedWords + 3 * k,
               f.sh[static_cast<std::size_t>(k) * f.stride + static_cast<std::size_t>(i)]);
}

TVSGS_HD inline void add(GrowthStatistics& sum, const GrowthStatistics& s) {
    sum.gradient += s.gradient, sum.abs_gradient += s.abs_gradient, sum.views += s.views;
    sum.max_radius_px = sum.max_radius_px < s.max_radius_px ? s.max_radius_px : sum.max_radius_px;
}

/// Whether the photograph says anything of a splat; what is not finite, too.
struct TouchedBody {
    SplatFindings found;
    Span<int> touched;
    TVSGS_HD void operator()(int i) const {
        bool any = found.statistics != nullptr && found.statistics[i].views > 0;
        visit_floats(found, i, [&any](int, float value) { any |= !(value == 0); });
        touched[i] = any;
    }
};

/// Records, word major: records[word * count + j].
struct PackBody {
    SplatFindings found;
    Span<const int> touched, first;
    std::uint32_t* records;
    std::size_t count;
    TVSGS_HD void operator()(int i) const {
        if (!touched[i]) return;
        std::uint32_t* const at = records + first[i];
        const auto put = [at, n = count](int word, const auto& value) {
            static_assert(sizeof value == sizeof *at);
            memcpy(at + static_cast<std::size_t>(word) * n, &value, sizeof value);
        };
        put(0, i);
        visit_floats(found, i, put);
        const GrowthStatistics none{0, 0, 0, 0},
            &s = found.statistics == nullptr ? none : found.statistics[i];
        put(12, s.gradient), put(13, s.abs_gradient), put(14, s.views), put(15, s.max_radius_px);
    }
};

/// Adds records of different splats.
struct AddRecordsBody {
    const std::uint32_t* records;
    std::size_t count;
    SplatFindings sum;
    TVSGS_HD void operator()(int j) const {
        const auto get = [at = records + j, n = count](int word, auto& value) {
            memcpy(&value, at + static_cast<std::size_t>(word) * n, sizeof value);
        };
        int i = 0;
        get(0, i);
        visit_floats(sum, i, [&get](int word, float& total) {
            float value = 0;
            get(word, value);
            total += value;
        });
        if (sum.statistics == nullptr) return;
        GrowthStatistics s;
        get(12, s.gradient), get(13, s.abs_gradient), get(14, s.views), get(15, s.max_radius_px);
        add(sum.statistics[i], s);
    }
};

/// The same for what lies in this process: what adds nothing leaves the bits as they are.
struct AddFindingsBody {
    SplatFindings found, sum;
    TVSGS_HD void operator()(int i) const {
        float values[SplatFindings::kFixedWords + 3 * kMaxShCount];
        visit_floats(found, i, [&values](int word, float value) { values[word] = value; });
        visit_floats(sum, i, [&values](int word, float& total) { total += values[word]; });
        if (sum.statistics != nullptr) add(sum.statistics[i], found.statistics[i]);
    }
};

/// From the sum over the photographs to their mean.
struct StepMeanBody {
    SplatFindings sum;
    float share;
    TVSGS_HD void operator()(int i) const {
        visit_floats(sum, i, [this](int, float& total) { total *= share; });
    }
};

/// values[i] <- the mean of numbers[i], numbers[width + i], ..., one for each photograph.
struct MeanNumbersBody {
    const double* numbers;
    int width, photographs;
    double* values;
    TVSGS_HD void operator()(int i) const {
        double sum = 0;
        for (int b = 0; b < photographs; ++b) sum += numbers[b * width + i];
        values[i] = sum / photographs;
    }
};

struct AddNumbersBody {
    const double* from;
    Span<double> to;
    TVSGS_HD void operator()(int i) const { to[i] += from[i]; }
};

template <class Device>
class StepBatch {
public:
    explicit StepBatch(Communicator* peers) : peers_(peers) {}

    /// In the place of Iteration::propagate() for iterations [first, last], a photograph each:
    /// leaves the mean of their gradients and of their losses in the iteration, adds up what they
    /// say about growth, and lets the terms learn from each.
    void propagate(
        int first, int last, Iteration<Device>& iteration, Training<Device>& t, bool for_step) {
        const Gaussians<Device>& g = t->gaussians;
        const int count = last - first + 1, ranks = size_of(peers_);
        measure(t);
        resize(sum_, g.size(), g.sh_degree);
        fill_zero(sum_);
        counts_ = t->densifier.sums_at(last, g);
        numbers_.resize(static_cast<std::size_t>(count * width_));
        for (int begin = 0; begin < count; begin += ranks) {
            const int mine = begin + rank_of(peers_), number = first + mine;
            if (mine < count) {
                const int after =
                    mine + ranks < count ? number + ranks : last + 1 + rank_of(peers_);
                look(number, last, after, iteration, t, for_step);
            }
            iteration.clock("exchange", [&] {
                gather_numbers(begin, mine < count);
                add_splats(mine < count, iteration, g.size());
            });
        }
        parallel_for(
            Device{}, g.size(),
            StepMeanBody{findings(sum_, nullptr, iteration), 1 / static_cast<float>(count)});
        iteration.replace(sum_);
        parallel_for(Device{}, static_cast<int>(t->losses.size()),
                     MeanNumbersBody{numbers_.data(), width_, count, iteration.values().data()});
        for (int b = 0; b < count; ++b) tell(first + b, numbers_.data() + b * width_, t);
    }

private:
    /// What a photograph says in numbers: values of the terms, their lessons, the derivatives by
    /// its camera.
    void measure(Training<Device>& t) {
        const auto terms = static_cast<int>(t->losses.size());
        lessons_.clear();
        width_ = terms;
        for (const auto& term : t->losses) {
            lessons_.push_back(width_);
            if (const auto* const lesson = term->lesson())
                width_ += static_cast<int>(lesson->size());
        }
        by_camera_ = width_;
        width_ += kCameraNumbers;
        mine_.resize(static_cast<std::size_t>(width_));
    }

    /// This process's photograph.
    void look(int number,
              int step,
              int after,
              Iteration<Device>& iteration,
              Training<Device>& t,
              bool for_step) {
        const DeviceView<Device>& view =
            iteration.fetch(number, t->sampler.view(number), t->losses,
                            [&] { return std::pair(after, t->sampler.view(after)); });
        mine_.fill_zero();
        const bool moves = !t->cameras.gradient_of(number, view.index).empty();
        iteration.propagate(
            number, step, view, t->gaussians, t->losses, t->field, for_step,
            moves ? Span<double>{mine_.data() + by_camera_, kCameraNumbers} : Span<double>{},
            [&](auto& values) {
                put(values, 0);
                for (std::size_t i = 0; i < t->losses.size(); ++i)
                    if (const auto* const lesson = t->losses[i]->lesson())
                        put(*lesson, lessons_[i]);
            });
        if (counts_ == nullptr) return;
        seen_.resize(t->gaussians.means.size());
        seen_.fill_zero();
        t->densifier.count_view(iteration.backbone().statistics(), seen_);
    }

    void put(const Buffer<double, Device>& from, int at) {
        detail::copy(Device{}, from.data(), Device{}, mine_.data() + at,
                     from.size() * sizeof(double));
    }

    void gather_numbers(int begin, bool there) {
        double* const to = numbers_.data() + begin * width_;
        const auto copy_to = [to](const Buffer<double, Device>& from) {
            detail::copy(Device{}, from.data(), Device{}, to, from.size() * sizeof(double));
        };
        if (peers_ == nullptr) return copy_to(mine_);
        peers_->all_gather_v("losses", mine_, there ? mine_.size() : 0, gathered_);
        copy_to(gathered_);
    }

    SplatFindings findings(Gaussians<Device>& gradients,
                           Buffer<GrowthStatistics, Device>* statistics,
                           const Iteration<Device>& iteration) {
        return {geometry_spans(gradients), gradients.sh.data(), gradients.means.size(),
                sh_count(iteration.sh_degree()),
                statistics == nullptr ? nullptr : statistics->data()};
    }

    /// Adds the photographs of this round. Of most splats a photograph says nothing, so processes
    /// exchange records of those of which it does.
    void add_splats(bool there, Iteration<Device>& iteration, int splats) {
        const SplatFindings sum = findings(sum_, counts_, iteration),
                            found = findings(iteration.gradients(),
                                             counts_ == nullptr ? nullptr : &seen_, iteration);
        if (peers_ == nullptr) return parallel_for(Device{}, splats, AddFindingsBody{found, sum});
        int own = 0;
        const auto words = static_cast<std::size_t>(sum.words());
        if (there) {
            touched_.resize(static_cast<std::size_t>(splats));
            parallel_for(Device{}, splats, TouchedBody{found, touched_.span()});
            own = exclusive_scan(touched_, first_);
            records_.resize(static_cast<std::size_t>(own) * words);
            parallel_for(
                Device{}, splats,
                PackBody{found, std::as_const(touched_).span(), std::as_const(first_).span(),
                         records_.data(), static_cast<std::size_t>(own)});
        }
        const std::vector<std::size_t> begins = peers_->all_gather_v(
            "gradients", records_, static_cast<std::size_t>(own) * words, all_records_);
        for (std::size_t r = 0; r + 1 < begins.size(); ++r) {
            const std::size_t count = (begins[r + 1] - begins[r]) / words;
            parallel_for(Device{}, static_cast<int>(count),
                         AddRecordsBody{all_records_.data() + begins[r], count, sum});
        }
    }

    /// The training hears of a photograph, on every process alike.
    void tell(int number, double* numbers, Training<Device>& t) {
        const int view = t->sampler.view(number);
        if (const Span<double> to = t->cameras.gradient_of(number, view); !to.empty())
            parallel_for(Device{}, kCameraNumbers, AddNumbersBody{numbers + by_camera_, to});
        for (std::size_t i = 0; i < t->losses.size(); ++i)
            if (t->losses[i]->lesson() != nullptr && t->losses[i]->active(number))
                t->losses[i]->learn(number, view, numbers + lessons_[i]);
        t.watch(number, view, {numbers, t->losses.size()});
    }

    Communicator* peers_;
    Gaussians<Device> sum_;
    Buffer<GrowthStatistics, Device>* counts_ = nullptr;  // of this step; null: not asked for
    Buffer<GrowthStatistics, Device> seen_;               // of this process's photograph
    int width_ = 0, by_camera_ = 0;                       // of the numbers of a photograph
    std::vector<int> lessons_;                            // where those of a term begin
    Buffer<double, Device> mine_, gathered_, numbers_;    // [photographs width]
    Buffer<int, Device> touched_, first_;
    Buffer<std::uint32_t, Device> records_, all_records_;
};

}  // namespace tvsgs
