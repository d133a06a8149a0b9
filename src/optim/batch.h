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

    /// Words of a record: the splat's place in its part, its geometry, its statistics, its
    /// harmonics.
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

/// Whether the photograph says anything of a splat; what is not finite, too. Splats count from
/// `begin` on.
struct TouchedBody {
    SplatFindings found;
    int begin;
    Span<int> touched;
    TVSGS_HD void operator()(int j) const {
        const int i = begin + j;
        bool any = found.statistics != nullptr && found.statistics[i].views > 0;
        visit_floats(found, i, [&any](int, float value) { any |= !(value == 0); });
        touched[j] = any;
    }
};

/// Records, word major: records[word * count + j].
struct PackBody {
    SplatFindings found;
    int begin, part_begin;  // of these splats, and of the part that they belong to
    Span<const int> touched, first;
    int before;  // what first[] begins with
    std::uint32_t* records;
    std::size_t count;
    TVSGS_HD void operator()(int j) const {
        if (!touched[j]) return;
        const int i = begin + j;
        std::uint32_t* const at = records + (first[j] - before);
        const auto put = [at, n = count](int word, const auto& value) {
            static_assert(sizeof value == sizeof *at);
            memcpy(at + static_cast<std::size_t>(word) * n, &value, sizeof value);
        };
        put(0, i - part_begin);
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
    /// `at_a_time`: splats of each process's part whose records are under way at a time; 0: as
    /// kExchangesOfPhotograph and kLeastExchanged have it.
    explicit StepBatch(Communicator* peers, int at_a_time = 0)
        : peers_(peers), at_a_time_(at_a_time) {}

    /// In the place of Iteration::propagate() for iterations [first, last], a photograph each:
    /// leaves the mean of their gradients in gradients() and that of their losses in the iteration,
    /// adds up what they say about growth, and lets the terms learn from each.
    void propagate(
        int first, int last, Iteration<Device>& iteration, Training<Device>& t, bool for_step) {
        const Gaussians<Device>& g = t->gaussians;
        const int count = last - first + 1, ranks = size_of(peers_);
        measure(t);
        const int own = own_part(peers_, g.size()).size();
        resize(sum_, own, g.sh_degree);
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
            Device{}, own,
            StepMeanBody{findings(sum_, nullptr, iteration), 1 / static_cast<float>(count)});
        parallel_for(Device{}, static_cast<int>(t->losses.size()),
                     MeanNumbersBody{numbers_.data(), width_, count, iteration.values().data()});
        for (int b = 0; b < count; ++b) tell(first + b, numbers_.data() + b * width_, t);
    }

    /// Of the step, of this process's part of the splats.
    Gaussians<Device>& gradients() { return sum_; }

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
        const std::size_t bytes = mine_.size() * sizeof(double);
        if (peers_ == nullptr) return detail::copy(Device{}, mine_.data(), Device{}, to, bytes);
        // Few enough to go by way of the host; up to 26 numbers are one exchange.
        peers_->all_gather_v("losses", to_host(mine_).data(), there ? bytes : 0, gathered_);
        detail::copy(Cpu{}, gathered_.data(), Device{}, to, gathered_.size());
    }

    SplatFindings findings(Gaussians<Device>& gradients,
                           Buffer<GrowthStatistics, Device>* statistics,
                           const Iteration<Device>& iteration) {
        return {geometry_spans(gradients), gradients.sh.data(), gradients.means.size(),
                sh_count(iteration.sh_degree()),
                statistics == nullptr ? nullptr : statistics->data()};
    }

    /// Adds the photographs of this round. Of most splats a photograph says nothing, so records of
    /// those of which it does go to the processes whose part these are. Some splats of each part
    /// at a time: what is under way stays small beside the gradients.
    void add_splats(bool there, Iteration<Device>& iteration, int splats) {
        const SplatFindings sum = findings(sum_, counts_, iteration),
                            found = findings(iteration.gradients(),
                                             counts_ == nullptr ? nullptr : &seen_, iteration);
        if (peers_ == nullptr) return parallel_for(Device{}, splats, AddFindingsBody{found, sum});
        const auto words = static_cast<std::size_t>(sum.words());
        const int ranks = peers_->size();
        int longest = 0;
        for (int r = 0; r < ranks; ++r)
            longest = std::max(longest, part_of(splats, r, ranks).size());
        const int at_a_time =
            at_a_time_ > 0
                ? at_a_time_
                : std::max(kLeastExchanged / ranks, longest / kExchangesOfPhotograph) + 1;
        for (int done = 0; done < longest; done += at_a_time) {
            const std::vector<std::size_t> to = pack_records(there, done, at_a_time, splats, found);
            const std::vector<std::size_t> from =
                peers_->all_to_all_v("gradients", records_, to, got_);
            for (std::size_t r = 0; r + 1 < from.size(); ++r) {
                const std::size_t count = (from[r + 1] - from[r]) / words;
                parallel_for(Device{}, static_cast<int>(count),
                             AddRecordsBody{got_.data() + from[r], count, sum});
            }
        }
    }

    /// records_ <- those of the splats [done, done + at_a_time) of each part, one part after the
    /// other; returns where each begins, words.
    std::vector<std::size_t> pack_records(
        bool there, int done, int at_a_time, int splats, const SplatFindings& found) {
        const int ranks = peers_->size();
        std::vector<Part> pieces;
        std::vector<int> at{0};  // of the pieces in touched_
        for (int r = 0; r < ranks; ++r) {
            const Part part = part_of(splats, r, ranks);
            const int begin = std::min(part.begin + done, part.end),
                      end = there ? std::min(begin + at_a_time, part.end) : begin;
            pieces.push_back({begin, end});
            at.push_back(at.back() + end - begin);
        }
        std::vector<std::size_t> begins(pieces.size() + 1, 0);
        if (at.back() == 0) return begins;
        touched_.resize(static_cast<std::size_t>(at.back()));
        const auto touched = [&](std::size_t r) {
            return touched_.span().sub(static_cast<std::size_t>(at[r]),
                                       static_cast<std::size_t>(pieces[r].size()));
        };
        for (std::size_t r = 0; r < pieces.size(); ++r)
            parallel_for(Device{}, pieces[r].size(),
                         TouchedBody{found, pieces[r].begin, touched(r)});
        const int total = exclusive_scan(touched_, first_);
        std::vector<int> before(pieces.size() + 1, total);
        for (std::size_t r = 0; r < pieces.size(); ++r)
            if (at[r] < at.back())
                detail::copy(Device{}, first_.data() + at[r], Cpu{}, &before[r], sizeof(int));
        const auto words = static_cast<std::size_t>(found.words());
        for (std::size_t r = 0; r <= pieces.size(); ++r)
            begins[r] = words * static_cast<std::size_t>(before[r]);
        records_.resize(begins.back());
        for (std::size_t r = 0; r < pieces.size(); ++r)
            parallel_for(Device{}, pieces[r].size(),
                         PackBody{found, pieces[r].begin,
                                  part_of(splats, static_cast<int>(r), ranks).begin, touched(r),
                                  std::as_const(first_).span().sub(
                                      static_cast<std::size_t>(at[r]),
                                      static_cast<std::size_t>(pieces[r].size())),
                                  before[r], records_.data() + begins[r],
                                  static_cast<std::size_t>(before[r + 1] - before[r])});
        return begins;
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
    int at_a_time_;
    Gaussians<Device> sum_;
    Buffer<GrowthStatistics, Device>* counts_ = nullptr;  // of this step; null: not asked for
    Buffer<GrowthStatistics, Device> seen_;               // of this process's photograph
    int width_ = 0, by_camera_ = 0;                       // of the numbers of a photograph
    std::vector<int> lessons_;                            // where those of a term begin
    Buffer<double, Device> mine_, numbers_;               // [width], [photographs width]
    std::vector<std::byte> gathered_;                     // the former, of a round
    Buffer<int, Device> touched_, first_;
    Buffer<std::uint32_t, Device> records_, got_;
};

}  // namespace tvsgs
